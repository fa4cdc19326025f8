// `vitreo runs`: list of the recorded runs, newest last.
// SPDX-License-Identifier: Apache-2.0
#include "host/cli/commands.h"
#include "host/config/config.h"
#include "host/runs/catalog.h"
#include "host/text/columns.h"
#include "host/text/markup.h"
#include "host/text/terminal_text.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <optional>
#include <ostream>
#include <set>
#include <string_view>
#include <vector>

namespace vitreo {
namespace {

/// A text in quotes for a query; one that has both kinds of quotes is no part of any record's name.
std::string quoted(const std::string& option, const std::string& text) {
  const char quote = text.find('"') == std::string::npos ? '"' : '\'';
  if (text.find(quote) != std::string::npos)
    throw ConfigError(option + ": wants a text without both kinds of quotes");
  return quote + text + quote;
}

/// The options as one condition. Times are compared as texts: ISO 8601 of one zone sorts as it
/// reads, and --since is the beginning of one, so only as many characters are compared as it has.
std::string condition_of(const RunFilter& filter) {
  std::vector<std::string> parts;
  if (!filter.protocol.empty()) {
    const std::string text = quoted("--protocol", filter.protocol);
    parts.push_back(fmt::format("(protocol ~ {} or title ~ {})", text, text));
  }
  if (!filter.operator_name.empty())
    parts.push_back("operator ~ " + quoted("--operator", filter.operator_name));
  if (!filter.state.empty()) parts.push_back("outcome = " + filter.state);
  if (!filter.since.empty()) parts.push_back("time >= " + filter.since);
  return fmt::format("{}", fmt::join(parts, " and "));
}

/// The beginning of "2026-11-21T14:30:05" at least as far as the year, or nothing.
bool is_time(const std::string& text) {
  constexpr std::string_view kShape = "dddd-dd-ddTdd:dd:dd";
  // The lengths at which a field is complete; 0 is the option that was not given.
  constexpr std::size_t kEnds[] = {0, 4, 7, 10, 13, 16, 19};
  if (std::find(std::begin(kEnds), std::end(kEnds), text.size()) == std::end(kEnds)) return false;
  for (std::size_t i = 0; i < text.size(); ++i)
    if (kShape[i] == 'd' ? text[i] < '0' || text[i] > '9' : text[i] != kShape[i]) return false;
  return true;
}

/// A filter that no run could pass is a mistake of typing.
void check(const RunFilter& filter) {
  static const std::vector<std::string> kStates{"completed", "failed",  "stopped",   "aborted",
                                                "lost",      "running", "unreadable"};
  if (!filter.state.empty() &&
      std::find(kStates.begin(), kStates.end(), filter.state) == kStates.end())
    throw ConfigError(
        fmt::format("--outcome: wants one of {}; got {}", fmt::join(kStates, ", "), filter.state));
  if (!is_time(filter.since))
    throw ConfigError("--since: wants a time such as 2026-11-21 or 2026-11-21T14:30; got " +
                      filter.since);
}

/// Of a value: a number in SI, a text, or nothing.
nlohmann::json json_of(const std::optional<CatalogValue>& value) {
  if (!value || (!value->number && value->text.empty())) return nullptr;  // or not a number
  if (value->text.empty() && value->number) return *value->number;
  // Both: a flag.
  if (value->number) return value->text == "true";
  return value->text;
}

// SI and untruncated, unlike the line for people below.
nlohmann::json json_of(const CatalogRow& row, const std::vector<std::string>& columns) {
  const RunHead& head = row.head;
  nlohmann::json json = {{"run", std::filesystem::path(head.folder).filename().string()},
                         {"folder", head.folder},
                         {"time", head.time},
                         {"protocol", head.protocol},
                         {"title", head.title},
                         {"operator", head.operator_name},
                         {"seed", head.seed},
                         {"rig", head.rig},
                         {"outcome", head.state},
                         {"reason", head.reason},
                         {"ended_by", head.ended_by},
                         {"experiment_time", head.experiment_time}};
  for (std::size_t i = 0; i < columns.size(); ++i)
    json["values"][columns[i]] = json_of(row.columns[i]);
  return json;
}

void print_json(const std::vector<CatalogRow>& rows, const std::vector<std::string>& columns,
                std::ostream& out) {
  nlohmann::json list = nlohmann::json::array();
  for (const CatalogRow& row : rows) list.push_back(json_of(row, columns));
  out << list.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace) << "\n";
}

/// RFC 4180.
std::string csv_cell(const std::string& text) {
  if (text.find_first_of(",\"\r\n") == std::string::npos) return text;
  std::string cell = "\"";
  for (const char c : text) cell += c == '"' ? std::string("\"\"") : std::string(1, c);
  return cell + "\"";
}

/// The SI unit of a column; of several all of them.
std::string unit_of(const std::vector<CatalogRow>& rows, std::size_t column) {
  std::set<std::string> units;
  for (const CatalogRow& row : rows)
    if (row.columns[column] && row.columns[column]->number) units.insert(row.columns[column]->unit);
  return fmt::format("{}", fmt::join(units, " or "));
}

void print_csv(const std::vector<CatalogRow>& rows, const std::vector<std::string>& columns,
               std::ostream& out) {
  out << "run,outcome,time,protocol,title,operator,seed,rig,experiment_time (s),reason,ended_by";
  for (std::size_t i = 0; i < columns.size(); ++i) {
    const std::string unit = unit_of(rows, i);
    out << "," << csv_cell(columns[i] + (unit.empty() ? "" : " (" + unit + ")"));
  }
  out << "\r\n";
  for (const CatalogRow& row : rows) {
    const RunHead& head = row.head;
    out << csv_cell(std::filesystem::path(head.folder).filename().string());
    for (const std::string& text :
         {head.state, head.time, head.protocol, head.title, head.operator_name, head.seed, head.rig,
          fmt::format("{}", head.experiment_time), head.reason, head.ended_by})
      out << "," << csv_cell(text);
    for (const auto& value : row.columns) {
      out << ",";
      if (!value) continue;
      out << csv_cell(value->text.empty() && value->number ? fmt::format("{}", *value->number)
                                                           : value->text);
    }
    out << "\r\n";
  }
}

/// Whether it is shown as a number: a flag has one as well, and is shown by its text.
bool is_number(const std::optional<CatalogValue>& value) {
  return value && value->number && std::isfinite(*value->number) && value->text.empty();
}

/// A column as people read it: its numbers in one unit. Protocols may have different quantities
/// under one name: then each number is in a unit of its own.
std::vector<std::string> shown_column(const std::vector<CatalogRow>& rows, std::size_t column) {
  std::vector<double> numbers;
  std::set<std::string> units;
  for (const CatalogRow& row : rows)
    if (const auto& value = row.columns[column]; is_number(value)) {
      numbers.push_back(*value->number);
      units.insert(value->unit);
    }
  const ShownColumn shown =
      units.size() == 1 ? show_column(numbers, *units.begin()) : ShownColumn();
  std::vector<std::string> cells;
  std::size_t next = 0;
  for (const CatalogRow& row : rows) {
    const auto& value = row.columns[column];
    if (!is_number(value))
      cells.push_back(value && !value->text.empty() ? for_terminal(value->text, 40) : "-");
    else if (units.size() == 1)
      cells.push_back(with_unit({shown.numbers[next++], shown.unit}));
    else
      cells.push_back(format_quantity(*value->number, value->unit));
  }
  return cells;
}

/// Columns under their names, right-aligned: a text a row, the first that of the head.
std::vector<std::string> columns_text(const std::vector<CatalogRow>& rows,
                                      const std::vector<std::string>& columns) {
  std::vector<std::string> lines(rows.size() + 1);
  for (std::size_t i = 0; i < columns.size(); ++i) {
    std::vector<std::string> cells = shown_column(rows, i);
    cells.insert(cells.begin(), columns[i]);
    std::size_t width = 0;
    for (const std::string& one : cells) width = std::max(width, count_characters(one));
    for (std::size_t k = 0; k < cells.size(); ++k)
      lines[k] += "  " + std::string(width - count_characters(cells[k]), ' ') + cells[k];
  }
  return lines;
}

// A line a run: of the reason only the first line, without control characters, since it may be a
// script's text.
void print_text(const std::vector<CatalogRow>& rows, const std::vector<std::string>& columns,
                std::ostream& out) {
  std::vector<double> times;
  for (const CatalogRow& row : rows) times.push_back(row.head.experiment_time);
  const ShownColumn time = show_column(times, "s");
  const std::vector<std::string> lines = columns_text(rows, columns);
  if (!columns.empty() && !rows.empty())
    out << fmt::format("{:<44} {:<10} {:>9}{}  title\n", "run", "outcome", "time", lines[0]);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const RunHead& head = rows[i].head;
    const std::string why = head.reason.substr(0, head.reason.find('\n'));
    out << fmt::format("{:<44} {:<10} {:>9}{}  {}{}\n",
                       std::filesystem::path(head.folder).filename().string(), head.state,
                       with_unit({time.numbers[i], time.unit}), lines[i + 1], head.title,
                       head.reason.empty() ? "" : ": " + for_terminal(why, 300));
  }
}

}  // namespace

int list_runs(const std::filesystem::path& parent, const RunFilter& filter, ListFormat format,
              std::ostream& out) {
  check(filter);
  Catalog catalog(parent);
  const std::string options = condition_of(filter);
  // The newest of what the conditions leave: `--protocol x --newest 5` is the five newest of that
  // protocol.
  const CatalogRequest request{filter.where, filter.columns, filter.sort,
                               static_cast<std::size_t>(std::max(filter.newest, 0))};
  const std::vector<CatalogRow> rows = catalog.find(request, options);
  switch (format) {
    case ListFormat::json:
      print_json(rows, filter.columns, out);
      return 0;
    case ListFormat::csv:
      print_csv(rows, filter.columns, out);
      return 0;
    case ListFormat::text:
      print_text(rows, filter.columns, out);
  }
  const bool filtered = !options.empty() || !filter.where.empty();
  if (rows.empty())
    out << "no " << (filtered ? "such " : "") << "runs in " << parent.string() << "\n";
  return 0;
}

}  // namespace vitreo
