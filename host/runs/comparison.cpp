// SPDX-License-Identifier: Apache-2.0
#include "host/runs/comparison.h"

#include "host/files/digest.h"
#include "host/record/parameter_text.h"
#include "host/text/columns.h"
#include "host/text/terminal_text.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <functional>
#include <set>
#include <stdexcept>

namespace vitreo {
namespace {

// The cell of a run that has no such value.
constexpr const char* kNone = "\u2013";

/// With the true minus sign, as numbers stand in print.
std::string in_print(const std::string& number) {
  return number.starts_with('-') ? "\u2212" + number.substr(1) : number;
}

/// What is asked of each run for one line.
using TextOfRun = std::function<std::string(const RunData&)>;

/// To what differs, or to the names of what does not.
/// Compared are the texts as they are shown, so that no row has cells that look the same.
void add_line(RunComparison& made, const std::vector<RunData>& runs, const std::string& name,
              const TextOfRun& text) {
  ComparedLine line{name, {}};
  for (const RunData& run : runs) {
    const std::string cell = text(run);
    line.cells.push_back(cell.empty() ? kNone : cell);
  }
  const bool same = std::all_of(line.cells.begin(), line.cells.end(),
                                [&line](const auto& cell) { return cell == line.cells.front(); });
  if (same)
    made.same.push_back(name);
  else
    made.differing.push_back(std::move(line));
}

/// Of all runs: protocols may differ, and with them the names.
void add_parameters(RunComparison& made, const std::vector<RunData>& runs) {
  std::set<std::string> names;
  for (const RunData& run : runs)
    if (run.start.parameters.is_object())
      for (const auto& [name, value] : run.start.parameters.items()) names.insert(name);
  for (const std::string& name : names)
    add_line(made, runs, name, [&name](const RunData& run) -> std::string {
      const nlohmann::json& all = run.start.parameters;
      return all.is_object() && all.contains(name) ? parameter_text(run.start, name, all[name])
                                                   : "";
    });
}

/// The rig as it was used, but for texts and paths.
/// The keys of a JSON object are sorted, so equal settings have one text. Eight digits are enough
/// to tell a few runs apart.
std::string rig_digest(const RunData& run) {
  const nlohmann::json& rig = run.start.rig;
  if (!rig.is_object() || !rig.contains("resolved")) return "";
  return sha256(rig["resolved"].dump()).substr(0, 8);
}

/// Without its folder: that is of the machine, not of the rig.
std::string rig_name(const RunData& run) {
  const std::string file =
      run.start.rig.is_object() ? run.start.rig.value("file", std::string()) : "";
  return std::filesystem::path(file).stem().string();
}

std::string version_of(const RunData& run) {
  const nlohmann::json& versions = run.start.versions;
  if (!versions.is_object()) return "";
  return versions.value("vitreo", std::string()) + " " + versions.value("commit", std::string());
}

/// One a run, SI; NaN where it is not stated. `units` takes those that were.
std::vector<double> values_of(const std::vector<RunData>& runs, const std::string& name,
                              std::set<std::string>& units) {
  std::vector<double> values;
  for (const RunData& run : runs) {
    double value = std::nan("");
    for (const StatedResult& one : run.results)
      if (one.name == name) value = one.value, units.insert(one.unit);
    values.push_back(value);
  }
  return values;
}

/// Each with its own unit: protocols may state different quantities under one name, and these have
/// no difference.
ComparedLine mixed_line(const std::vector<RunData>& runs, const std::string& name) {
  ComparedLine line{name, {}};
  for (const RunData& run : runs) {
    std::string cell = kNone;
    for (const StatedResult& one : run.results)
      if (one.name == name && std::isfinite(one.value))
        cell = in_print(format_quantity(one.value, one.unit));
    line.cells.push_back(cell);
  }
  return line;
}

/// Names in the order in which the runs state them; how long a run took comes last.
std::vector<std::string> result_names(const std::vector<RunData>& runs) {
  std::vector<std::string> names;
  for (const RunData& run : runs)
    for (const StatedResult& one : run.results)
      if (std::find(names.begin(), names.end(), one.name) == names.end()) names.push_back(one.name);
  std::stable_partition(names.begin(), names.end(), [](const std::string& name) {
    return name != "wall_time" && name != "experiment_time" && name != "dead_time";
  });
  return names;
}

ComparedLine result_line(const std::vector<RunData>& runs, const std::string& name) {
  std::set<std::string> units;
  const std::vector<double> values = values_of(runs, name, units);
  if (units.size() > 1) return mixed_line(runs, name);
  const std::string unit = units.empty() ? "" : *units.begin();
  std::vector<double> column;
  std::copy_if(values.begin(), values.end(), std::back_inserter(column),
               [](double value) { return std::isfinite(value); });
  const bool two = runs.size() == 2 && column.size() == 2;
  const ShownColumn shown = show_column(column, unit);
  ComparedLine line{shown.unit.empty() ? name : name + " (" + shown.unit + ")", {}};
  std::size_t next = 0;
  for (const double value : values)
    line.cells.push_back(std::isfinite(value) ? in_print(shown.numbers[next++]) : kNone);
  if (!two) return line;
  const auto in = column_unit(column, unit);
  // Of the values and not of the cells, whose rounding would show in it.
  const double difference = (values[1] - values[0]) / (in ? in->factor : 1);
  line.difference = (difference > 0 ? "+" : "") + in_print(format_number(difference));
  return line;
}

}  // namespace

// Protocol first, then what was asked of it, then where and with what.
RunComparison compare_runs(const std::vector<RunData>& runs) {
  if (runs.size() < 2 || runs.size() > kMostCompared)
    throw std::invalid_argument(
        fmt::format("compare: wants 2 to {} runs; got {}", kMostCompared, runs.size()));
  RunComparison made;
  for (std::size_t i = 0; i < runs.size(); ++i)
    made.names.emplace_back(1, static_cast<char>('A' + i));
  add_line(made, runs, "protocol", [](const RunData& run) { return run.start.protocol_title; });
  add_parameters(made, runs);
  add_line(made, runs, "seed", [](const RunData& run) { return std::to_string(run.start.seed); });
  add_line(made, runs, "rig", rig_name);
  add_line(made, runs, "settings of the rig (digest)", rig_digest);
  add_line(made, runs, "protocol's text (digest)",
           [](const RunData& run) { return sha256(run.start.protocol_text).substr(0, 8); });
  add_line(made, runs, "version", version_of);
  add_line(made, runs, "outcome", [](const RunData& run) {
    return run.end ? std::string(to_string(run.end->outcome)) : "running";
  });
  for (const std::string& name : result_names(runs))
    made.results.push_back(result_line(runs, name));
  return made;
}

// Names to the left, cells to the right, as wide as the widest.
std::string comparison_text(const std::vector<RunData>& runs) {
  const RunComparison made = compare_runs(runs);
  std::string text;
  for (std::size_t i = 0; i < runs.size(); ++i)
    text += made.names[i] + "  " + runs[i].folder.filename().string() + "\n";
  std::vector<ComparedLine> lines{{"", made.names, runs.size() == 2 ? "B \u2212 A" : ""}};
  lines.insert(lines.end(), made.differing.begin(), made.differing.end());
  lines.insert(lines.end(), made.results.begin(), made.results.end());
  std::vector<std::size_t> widths(runs.size() + 1);
  for (const ComparedLine& line : lines) {
    widths[0] = std::max(widths[0], columns_of(line.name));
    for (std::size_t i = 0; i < line.cells.size(); ++i)
      widths[i + 1] = std::max(widths[i + 1], columns_of(line.cells[i]));
  }
  // Columns of the terminal, not bytes: µ has two bytes and one column.
  const auto padded = [](const std::string& cell, std::size_t width, bool right) {
    const std::string blanks(width - std::min(width, columns_of(cell)), ' ');
    return right ? blanks + cell : cell + blanks;
  };
  for (const ComparedLine& line : lines) {
    std::string row = padded(line.name, widths[0], false);
    for (std::size_t i = 0; i < line.cells.size(); ++i)
      row += "  " + padded(line.cells[i], widths[i + 1], true);
    if (!line.difference.empty()) row += "  " + line.difference;
    // Names come from scripts: control characters must not reach the terminal.
    text += harmless(row) + "\n";
  }
  return text;
}

}  // namespace vitreo
