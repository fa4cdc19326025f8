// `vitreo show RUN`: summary of a run, what was asked, what came out, what is recorded.
// SPDX-License-Identifier: Apache-2.0
#include "devices/links/printable.h"
#include "host/cli/commands.h"
#include "host/engine/link_trace.h"
#include "host/files/digest.h"
#include "host/record/parameter_text.h"
#include "host/record/record_json.h"
#include "host/record/recorder.h"
#include "host/runs/results_text.h"
#include "host/runs/run_reader.h"
#include "host/text/columns.h"
#include "host/text/markup.h"
#include "host/text/terminal_text.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <ostream>
#include <set>
#include <vector>

namespace vitreo {
namespace {

// Names, units and counts only: the samples themselves are what `vitreo export` is for.
nlohmann::json streams_of(const RunData& data) {
  nlohmann::json list = nlohmann::json::array();
  // The meaning of a channel is in the record itself since schema 5; empty in older ones.
  for (const Stream& stream : data.streams) {
    nlohmann::json channels = nlohmann::json::array();
    for (const Channel& channel : stream.info.channels)
      channels.push_back({{"name", channel.name},
                          {"unit", channel.unit},
                          {"help", channel.help},
                          {"axes", channel.axes}});
    list.push_back({{"name", stream.info.name},
                    {"source", stream.info.source},
                    {"clock", stream.info.clock},
                    {"channels", channels},
                    {"samples", stream.times.size()}});
  }
  return list;
}

/// The summary, and what only the whole record has.
/// Texts of protocol and modules go in as hashes: two runs can be compared by them, and the JSON
/// stays of a size that a person can read.
nlohmann::json json_of(const RunData& data, const RunHead& head) {
  nlohmann::json json = summary(data);
  json["outcome"] = head.state;
  json["time"] = head.time;
  json["folder"] = data.folder.string();
  json["streams"] = streams_of(data);
  json["versions"] = data.start.versions;
  json["devices"] = data.start.devices;
  json["files"] = data.start.files;
  json["protocol_hash"] = sha256(data.start.protocol_text);
  // Scripts that the protocol required: a change in one of them is a change of the run.
  json["modules"] = nlohmann::json::object();
  for (const Module& module : data.modules) json["modules"][module.name] = sha256(module.text);
  json["record_version"] = data.version;
  json["tables"] = nlohmann::json::array();
  for (const Table& table : data.tables)
    json["tables"].push_back(
        {{"title", table.title}, {"header", table.header}, {"rows", table.rows}});
  json["events"] = nlohmann::json::array();
  for (const Event& event : data.events)
    json["events"].push_back(
        {{"time", to_seconds(event.time)}, {"kind", event.kind}, {"text", event.text}});
  return json;
}

// Without JSON's quotes where it is a text, for a line that people read.
std::string text_of(const nlohmann::json& value) {
  return value.is_string() ? value.get<std::string>() : dumped(value);
}

void print_labels(const char* what, const nlohmann::json& labels, std::ostream& out) {
  if (!labels.is_object()) return;
  for (const auto& [name, value] : labels.items())
    out << fmt::format("{:<9} {} = {}\n", what, for_terminal(name), for_terminal(text_of(value)));
}

/// As the report has it: "um" as a script writes it is read as µm.
Table in_print(Table table) {
  table.title = with_print_units(table.title);
  for (std::string& cell : table.header) cell = with_print_units(cell);
  for (auto& row : table.rows)
    for (std::string& cell : row) cell = with_print_units(cell);
  return table;
}

/// In columns as wide as their widest cell.
void print(const Table& table, std::ostream& out) {
  std::vector<std::size_t> widths;
  const auto widen = [&widths](const std::vector<std::string>& cells) {
    widths.resize(std::max(widths.size(), cells.size()));
    for (std::size_t i = 0; i < cells.size(); ++i)
      widths[i] = std::max(widths[i], count_characters(for_terminal(cells[i])));
  };
  widen(table.header);
  for (const auto& row : table.rows) widen(row);
  const auto line = [&](const std::vector<std::string>& cells) {
    std::string text = " ";
    for (std::size_t i = 0; i < cells.size(); ++i) {
      const std::string cell = for_terminal(cells[i]);
      text += " " + cell + std::string(widths[i] - count_characters(cell) + 1, ' ');
    }
    text.erase(text.find_last_not_of(' ') + 1);
    out << text << "\n";
  };
  out << "table     " << for_terminal(table.title) << "\n";
  line(table.header);
  for (const auto& row : table.rows) line(row);
}

void print(const RunData& data, const RunHead& head, std::ostream& out) {
  out << fmt::format("{}\n{}: {}{}{}\n", data.folder.filename().string(), data.start.protocol_title,
                     head.state, head.reason.empty() ? "" : ": ", for_terminal(head.reason));
  out << fmt::format("when      {}\nprotocol  {}\noperator  {}\nseed      {}\ncommit    {}\n",
                     head.time, data.start.protocol_file, data.start.operator_name, data.start.seed,
                     data.start.versions.is_object()
                         ? text_of(data.start.versions.value("commit", nlohmann::json("")))
                         : "");
  if (data.end && !data.end->cause.by.empty())
    out << fmt::format("ended by  {}\n", for_terminal(cause_text(data.end->cause)));
  print_labels("tag", data.start.tags, out);
  print_labels("sample", data.start.sample, out);
  if (const std::string rest = coil_rest_text(data); !rest.empty())
    out << fmt::format("at end    {}\n", for_terminal(rest));
  if (data.start.parameters.is_object())
    for (const auto& [name, value] : data.start.parameters.items())
      out << fmt::format("  {:<26} {}\n", name, parameter_text(data.start, name, value));
  out << results_text(data.results);
  for (const Table& table : data.tables) print(in_print(table), out);
  for (const Stream& stream : data.streams)
    out << fmt::format("stream {:<21} {} samples, {} channels, {}\n", stream.info.name,
                       stream.times.size(), stream.info.channels.size(), stream.info.source);
  if (!data.links.empty())
    out << fmt::format("links  {:<21} {} lines: vitreo show {} --links\n", "", data.links.size(),
                       data.folder.filename().string());
  const nlohmann::json numbers = summary(data);
  for (const auto& [camera, counts] : numbers.at("frames").items())
    out << fmt::format("frames {:<21} {} recorded, {} dropped by the recorder, {} lost before it\n",
                       camera, dumped(counts.at("recorded")), dumped(counts.at("dropped")),
                       dumped(counts.at("lost")));
  for (const Event& event : data.events)
    // The events that explain an outcome; the others are in the report and under --json.
    if (event.kind.starts_with("alarm") || event.kind == "error" || event.kind == "override")
      out << fmt::format("{:>10.3f} s  {}: {}\n", to_seconds(event.time), event.kind, event.text);
  out << "report: " << (data.folder / "report.html").string() << "\n";
}

/// Texts as they are printed, bytes in hexadecimal.
nlohmann::json json_of(const std::vector<LinkRow>& rows) {
  // Time in s of the run's clock.
  nlohmann::json list = nlohmann::json::array();
  for (const LinkRow& row : rows)
    list.push_back({{"time", to_seconds(row.time)},
                    {"role", row.role},
                    {"address", row.address},
                    {"event", row.event},
                    {"text", printable(row.bytes, row.bytes.size())},
                    {"hex", fmt::format("{:02x}", fmt::join(row.bytes, ""))}});
  return list;
}

}  // namespace

int show_links(const std::filesystem::path& folder, const std::string& role, bool json,
               std::ostream& out) {
  std::vector<LinkRow> rows = read_run(folder).links;
  if (rows.empty())
    throw RecordError(folder.string() +
                      ": has no bytes of links; vitreo run --trace-links records them");
  std::set<std::string> roles;
  for (const LinkRow& row : rows) roles.insert(row.role);
  // Refused and not empty: a misspelt role would look like a silent instrument.
  if (!role.empty() && !roles.contains(role))
    throw RecordError(fmt::format("{}: no link of the role {} was traced, only of {}",
                                  folder.string(), role, fmt::join(roles, ", ")));
  if (!role.empty()) std::erase_if(rows, [&](const LinkRow& row) { return row.role != role; });
  out << (json ? dumped(json_of(rows)) + "\n" : to_text(rows));
  return 0;
}

int show_run(const std::filesystem::path& folder, bool json, std::ostream& out) {
  const RunData data = read_run(folder);
  // The record has no outcome before its end; the head says whether it is running or lost.
  const RunHead head = read_head(folder);
  if (json)
    out << dumped(json_of(data, head)) << "\n";
  else
    print(data, head, out);
  return 0;
}

}  // namespace vitreo
