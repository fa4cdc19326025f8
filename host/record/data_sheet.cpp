// SPDX-License-Identifier: Apache-2.0
#include "host/record/data_sheet.h"

#include "host/files/run_folder.h"
#include "host/record/meaning.h"
#include "host/record/parameter_text.h"
#include "host/record/record_schema.h"

#include <fmt/format.h>

#include <chrono>
#include <set>

namespace vitreo {
namespace {

/// A cell of a table: one line, without its separator.
std::string cell(std::string text) {
  for (char& c : text)
    if (c == '\n' || c == '\r') c = ' ';
  for (std::size_t at = text.find('|'); at != std::string::npos; at = text.find('|', at + 2))
    text.insert(at, "\\");
  return text;
}

/// Empty where it is missing: records of older versions have fewer keys.
std::string text_in(const nlohmann::json& object, const char* key) {
  if (!object.is_object() || !object.contains(key)) return "";
  return object[key].is_string() ? object[key].get<std::string>() : object[key].dump();
}

/// system_clock may be coarser than a nanosecond: the exact number stands beside the text.
std::string utc_of(std::int64_t nanoseconds) {
  return utc_text(std::chrono::system_clock::time_point(
      std::chrono::duration_cast<std::chrono::system_clock::duration>(
          std::chrono::nanoseconds(nanoseconds))));
}

/// One line "- title: name value, ..."; nothing for an empty object.
void list_of(const nlohmann::json& object, const std::string& title, std::string& out) {
  if (!object.is_object() || object.empty()) return;
  out += "- " + title + ":";
  const char* separator = " ";
  for (const auto& [name, value] : object.items()) {
    out +=
        separator + name + " " + cell(value.is_string() ? value.get<std::string>() : value.dump());
    separator = ", ";
  }
  out += "\n";
}

/// What was run, by whom, on what.
std::string provenance(const RunData& data) {
  const RunStart& start = data.start;
  std::string out = "# " + data.folder.filename().string() + "\n\n";
  out += fmt::format("A run of \"{}\" ({}).", cell(start.protocol_title), start.protocol_file);
  out += data.end ? fmt::format(" It ended as {}{}.", to_string(data.end->outcome),
                                data.end->reason.empty() ? "" : ": " + cell(data.end->reason))
                  : " It has no end record.";
  out += fmt::format(" Record of version {}, written by Vitreo {} (commit {}).\n\n", data.version,
                     text_in(start.versions, "vitreo"), text_in(start.versions, "commit"));
  out += fmt::format("- operator: {}\n- seed: {}\n", cell(start.operator_name), start.seed);
  if (data.end && !data.end->cause.by.empty())
    out += "- ended by: " + cell(cause_text(data.end->cause)) + "\n";
  list_of(start.tags, "tags", out);
  list_of(start.sample, "sample", out);
  out += fmt::format("- rig file: {}\n", text_in(start.rig, "file"));
  list_of(start.devices, "instruments", out);
  if (start.parameters.is_object() && !start.parameters.empty()) {
    out += "- parameters:";
    const char* separator = " ";
    for (const auto& [name, value] : start.parameters.items()) {
      out += separator + name + " = " + cell(plain_parameter_text(start, name, value));
      separator = ", ";
    }
    out += "\n";
  }
  return out + "\nEvery number in the record is in the SI unit that stands beside it.\n\n";
}

/// Of a kind of meanings those that this record uses; no names: all of them.
std::string of_kind(const std::string& kind, const std::set<std::string>& names) {
  std::string out;
  for (const Meaning& one : meanings())
    if (one.kind == kind && (names.empty() || names.contains(one.name)))
      out += "- `" + one.name + "`: " + one.text + "\n";
  return out;
}

/// What t_ns counts, and from when: without it no stream can be laid beside data of another source.
std::string times(const RunData& data) {
  std::string out = "## Times\n\n`t_ns` counts nanoseconds of the run's clock.";
  if (data.start.t0_utc_ns)
    out += fmt::format(" `t_ns` = 0 was at {} UTC (`run.t0_utc_ns` = {}).\n\nThe clock is:\n\n",
                       utc_of(*data.start.t0_utc_ns), *data.start.t0_utc_ns);
  else
    out += " When it was 0 this record does not say.\n\n";
  if (!data.start.clock.empty()) out += of_kind("time", {data.start.clock}) + "\n";
  std::set<std::string> clocks;
  for (const Stream& stream : data.streams)
    if (!stream.info.clock.empty()) clocks.insert(stream.info.clock);
  if (clocks.empty()) return out;
  return out + "The time of a stream's row is one of these instants:\n\n" +
         of_kind("clock", clocks) + "\n";
}

/// By the record's own rows and not by the program's: a record of an older version describes
/// itself.
std::string streams(const RunData& data) {
  std::set<std::string> axes;
  std::string out;
  for (const Stream& stream : data.streams) {
    out += fmt::format("### `sample_{}`\n\n{}. {} rows", stream.info.name, cell(stream.info.source),
                       stream.times.size());
    out += stream.info.clock.empty() ? ".\n\n" : "; their time is: " + stream.info.clock + ".\n\n";
    out += "| channel | unit | axes | what it is |\n|---|---|---|---|\n";
    for (const Channel& one : stream.info.channels) {
      out += fmt::format("| `{}` | {} | {} | {} |\n", one.name, one.unit, one.axes, cell(one.help));
      if (!one.axes.empty()) axes.insert(one.axes);
    }
    out += "\n";
  }
  if (out.empty()) return "";
  const std::string frames = axes.empty() ? "" : "Axes:\n\n" + of_kind("axes", axes) + "\n";
  return "## Streams\n\nEach stream is a table of run.sqlite; NULL: there was no value.\n\n" +
         frames + out;
}

std::string cameras(const RunData& data) {
  if (data.cameras.empty()) return "";
  std::string out =
      "## Frames\n\n| camera | recorded | each | frame period, s | pixel, m |\n"
      "|---|---|---|---|---|\n";
  for (const RecordedCameraInfo& one : data.cameras) {
    std::size_t count = 0;
    for (const FrameRow& row : data.frames) count += row.camera == one.camera ? 1 : 0;
    out += fmt::format("| `{}` | {} | {} | {} | {} |\n", one.camera, count, one.every,
                       one.frame_period, one.effective_pixel);
  }
  return out + "\n";
}

/// The schema of this version: a record of an older one may lack some of it (data_sheet.h).
std::string tables() {
  std::string out = "## Tables of run.sqlite\n\n";
  for (const RecordTable& table : record_tables()) {
    out += fmt::format("### `{}`\n\n{}.\n\n| column | unit | what it is |\n|---|---|---|\n",
                       table.name, table.help);
    for (const RecordColumn& one : record_columns())
      if (std::string_view(one.table) == table.name)
        out += fmt::format("| `{}` | {} | {} |\n", one.name, one.unit, cell(one.help));
    out += "\n";
  }
  return out;
}

}  // namespace

std::string data_sheet(const RunData& data) {
  std::string out = provenance(data) + "## Files\n\n" + of_kind("file", {}) + "\n" + times(data) +
                    streams(data) + cameras(data) + tables();
  // One end of line at the end, as editors and checkers of Markdown want it.
  while (out.ends_with("\n\n")) out.pop_back();
  return out;
}

}  // namespace vitreo
