// SPDX-License-Identifier: Apache-2.0
#include "host/trials/sweep_report.h"

#include "host/config/config.h"
#include "host/files/published_file.h"
#include "host/runs/report_page.h"
#include "host/text/columns.h"
#include "host/text/markup.h"
#include "host/text/terminal_text.h"
#include "host/trials/sweep_drawings.h"
#include "host/trials/sweep_groups.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>

namespace vitreo {
namespace {

// Bounds of a page that a browser lays out at once; sweep.csv has everything.
constexpr std::size_t kRowsShown = 200;  // of a table
constexpr std::size_t kFailuresListed = 50;
constexpr std::size_t kSlowest = 10;
constexpr std::size_t kResultsDrawn = 12;

// Beyond the report's own style.
constexpr const char* kStyle =
    ".lead { font-size: 17px; margin: 6px 0 0; }\n"
    ".missing { background: #8a6100; } td.n { text-align: right; white-space: nowrap; }\n"
    "th.n { text-align: right; }\n";

/// A section without a body is left out with its title.
std::string page_section(const std::string& title, const std::string& body) {
  return body.empty() ? ""
                      : "<section><h2>" + escape_markup(title) + "</h2>\n" + body + "</section>\n";
}

std::string plural(std::size_t count, const std::string& word) {
  return fmt::format("{} {}{}", count, word, count == 1 ? "" : "s");
}

/// The results in the order in which they are shown; `shown` first.
std::vector<std::size_t> result_columns(const SweepTable& table, const std::string& shown) {
  std::vector<std::size_t> columns;
  // Roles are of the plan: varied parameters and fixed ones are no results.
  for (std::size_t i = 0; i < table.columns.size(); ++i)
    if (table.columns[i].role == ColumnRole::result) columns.push_back(i);
  // What every run states, how long it took, comes last.
  std::stable_partition(columns.begin(), columns.end(), [&table](std::size_t column) {
    const std::string& name = table.columns[column].name;
    return name != "experiment_time" && name != "dead_time";
  });
  if (shown.empty()) return columns;
  const auto first = std::find_if(columns.begin(), columns.end(), [&](std::size_t column) {
    return table.columns[column].name == shown;
  });
  // The name comes from the command line: a misspelt one is told with what there is.
  if (first == columns.end()) {
    std::vector<std::string> known;
    for (const std::size_t column : columns) known.push_back(table.columns[column].name);
    throw ConfigError("--show: no run stated a result " + shown +
                      fmt::format("; there are {}", fmt::join(known, ", ")));
  }
  // A rotation and not a swap: the others keep their order.
  std::rotate(columns.begin(), first, first + 1);
  return columns;
}

/// Green only where every point completed.
std::string badge_of(const SweepTable& table) {
  std::size_t completed = 0;
  for (std::size_t row = 0; row < table.rows.size(); ++row) completed += is_completed(table, row);
  const bool all = completed == table.rows.size();
  // Missing points are no failures: the sweep can be resumed.
  const char* const kind = all ? "completed" : table.missing > 0 ? "missing" : "failed";
  return fmt::format("<span class=\"badge {}\">{} {} of {} completed</span>", kind,
                     all ? "\u2713" : "!", completed, table.rows.size());
}

/// "speed × law, 10 settings, 3 repeats each, each run with a seed of its own".
std::string lead_of(const SweepTable& table, const nlohmann::json& head,
                    const std::vector<VariedColumn>& varied) {
  std::string text;
  for (const VariedColumn& one : varied) text += (text.empty() ? "" : " \u00d7 ") + one.name;
  if (text.empty()) text = "seeds alone";
  text += ", " + plural(settings_in(table).size(), "setting");
  // A plan without the key is of one repeat each.
  const std::size_t repeats = head.value("repeats", std::size_t{1});
  if (repeats > 1) text += fmt::format(", {} repeats each", repeats);
  // How seeds were dealt decides what the spread between repeats means.
  const std::string seeds = head.value("seeds", "fresh");
  text += seeds == "fresh"    ? "; every run has a seed of its own"
          : seeds == "paired" ? "; every setting has the same seeds"
                              : "; all runs have one seed";
  if (table.missing > 0) text += fmt::format("; {} not run yet", plural(table.missing, "point"));
  return text;
}

/// Title, how many completed, what was varied, and the facts of the plan.
std::string report_head(const SweepTable& table, const nlohmann::json& head,
                        const std::vector<VariedColumn>& varied) {
  const nlohmann::json& protocol = head.at("protocol");
  std::string out = "<header><h1>Sweep: " + escape_markup(protocol.value("title", "")) + "</h1>" +
                    badge_of(table) + "</header>\n<p class=\"lead\">" +
                    escape_markup(lead_of(table, head, varied)) + "</p>\n<div class=\"facts\">";
  const auto fact = [&out](const char* name, const std::string& value) {
    if (!value.empty()) out += fmt::format("<span>{} <b>{}</b></span>", name, escape_markup(value));
  };
  // Of the plan and not of the runs: these hold for every point, also for those that never ran.
  fact("Begun", head.value("created", ""));
  fact("Protocol", protocol.value("name", ""));
  fact("Rig", head.at("rig").value("name", ""));
  fact("Operator", head.value("operator", ""));
  fact("First seed", std::to_string(head.value("seed", std::uint64_t{1})));
  fact("Version", head.value("/versions/vitreo"_json_pointer, ""));
  return out + "</div>\n";
}

/// "speed 0.5 mm/s, law pd".
std::string setting_text(const SweepTable& table, const std::vector<VariedColumn>& varied,
                         std::size_t row) {
  std::string text;
  for (const VariedColumn& one : varied) {
    // The label is in the unit that the whole column is shown in.
    const std::string& label = one.labels[one.places[row]];
    text += fmt::format("{}{} {}{}{}", text.empty() ? "" : ", ", one.name, label,
                        one.unit.empty() ? "" : " ", print_unit(one.unit));
  }
  return text.empty() ? "point " + text_in(table.rows[row][0]) : text;
}

/// Where the first result is least and most, as tiles.
std::string extreme_tiles(const SweepTable& table, const std::vector<VariedColumn>& varied,
                          std::size_t column) {
  struct Extreme {
    double median = std::nan("");
    std::size_t row = 0;
  } least, most;
  // Failed repeats have no result; a setting of failed ones alone takes no part.
  for (const auto& setting : settings_in(table)) {
    std::vector<std::size_t> rows;
    std::copy_if(setting.begin(), setting.end(), std::back_inserter(rows),
                 [&table](std::size_t row) { return is_completed(table, row); });
    const double median = spread_of(numbers_of(table, column, rows)).median;
    if (std::isnan(median)) continue;
    // Both are NaN at first, with which every comparison is false: the first median is taken.
    if (!(median >= least.median)) least = {median, rows.front()};
    if (!(median <= most.median)) most = {median, rows.front()};
  }
  if (std::isnan(least.median)) return "";
  const SweepColumn& about = table.columns[column];
  const auto tile = [&](const char* word, const Extreme& one) {
    // Each tile in a unit of its own size: the two ends may be decades apart.
    const Shown shown = show_quantity(one.median, about.unit);
    return fmt::format(
        "<div class=\"tile\"><div class=\"name\">{} {}</div><div class=\"value\">{} <span "
        "class=\"unit\">{}</span></div><div class=\"name\">{}</div></div>\n",
        word, escape_markup(about.name), escape_markup(shown.number), escape_markup(shown.unit),
        escape_markup(setting_text(table, varied, one.row)));
  };
  return "<div class=\"tiles\">\n" + tile("Least", least) + tile("Largest", most) + "</div>\n";
}

/// Cells are HTML already.
std::string cells_row(const char* tag, const std::vector<std::string>& cells,
                      const std::vector<bool>& right) {
  std::string row = "<tr>";
  for (std::size_t i = 0; i < cells.size(); ++i)
    // Numbers stand at the right, so that their places can be compared.
    row += fmt::format("<{0}{1}>{2}</{0}>", tag, right[i] ? " class=\"n\"" : "", cells[i]);
  return row + "</tr>\n";
}

std::string html_table(const std::vector<std::string>& header, const std::vector<bool>& right,
                       const std::vector<std::vector<std::string>>& rows) {
  if (rows.empty()) return "";
  std::string out = "<div class=\"scroll long\"><table><thead>" + cells_row("th", header, right) +
                    "</thead>\n<tbody>";
  for (const auto& row : rows) out += cells_row("td", row, right);
  return out + "</tbody></table></div>\n";
}

/// Each setting with the median and the quartiles of each result, a column in one unit.
std::string settings_table(const SweepTable& table, const std::vector<VariedColumn>& varied,
                           const std::vector<std::size_t>& results) {
  const auto settings = settings_in(table);
  const std::size_t shown = std::min(settings.size(), kRowsShown);
  std::vector<std::string> header;
  std::vector<bool> right;
  for (const VariedColumn& one : varied)
    header.push_back(escape_markup(one.title())), right.push_back(one.numeric);
  header.emplace_back("completed"), right.push_back(true);
  std::vector<std::vector<std::string>> rows(shown);
  std::vector<std::vector<std::size_t>> completed(shown);
  for (std::size_t i = 0; i < shown; ++i) {
    for (const VariedColumn& one : varied)
      rows[i].push_back(escape_markup(one.labels[one.places[settings[i].front()]]));
    std::copy_if(settings[i].begin(), settings[i].end(), std::back_inserter(completed[i]),
                 [&table](std::size_t row) { return is_completed(table, row); });
    rows[i].push_back(fmt::format("{} of {}", completed[i].size(), settings[i].size()));
  }
  for (const std::size_t column : results) {
    std::vector<double> numbers;
    for (std::size_t i = 0; i < shown; ++i) {
      // Median and quartiles, three numbers a setting, in one list for the common unit.
      const Spread spread = spread_of(numbers_of(table, column, completed[i]));
      numbers.insert(numbers.end(), {spread.median, spread.low, spread.high});
    }
    const ShownColumn printed = show_column(numbers, table.columns[column].unit);
    header.push_back(escape_markup(table.columns[column].name +
                                   (printed.unit.empty() ? "" : " (" + printed.unit + ")")));
    right.push_back(true);
    for (std::size_t i = 0; i < shown; ++i) {
      const bool many = completed[i].size() > 1;
      rows[i].push_back(completed[i].empty() || std::isnan(numbers[3 * i])
                            ? "\u2013"
                            : printed.numbers[3 * i] +
                                  (many ? fmt::format(" ({}\u2013{})", printed.numbers[3 * i + 1],
                                                      printed.numbers[3 * i + 2])
                                        : ""));
    }
  }
  const std::string rest =
      shown < settings.size()
          ? fmt::format("<p>{} more settings are in sweep.csv.</p>\n", settings.size() - shown)
          : "";
  return html_table(header, right, rows) + rest;
}

/// The run's report, where there is a run.
std::string link_of(const SweepTable& table, std::size_t row, const std::string& runs) {
  // Relative to the page: the folder of the sweep may be moved as a whole.
  if (table.runs[row].empty()) return "";
  return fmt::format("<a href=\"{}/{}/report.html\">report</a>", escape_markup(runs),
                     escape_markup(table.runs[row]));
}

/// How many of each outcome, and the first of them with their reasons.
std::string failures(const SweepTable& table, const std::vector<VariedColumn>& varied) {
  const std::size_t outcome = table.column("outcome");
  const std::size_t reason = table.column("reason");
  std::vector<std::vector<std::string>> rows;
  std::map<std::string, std::size_t> counts;
  std::size_t failed = 0;
  for (std::size_t row = 0; row < table.rows.size(); ++row) {
    const std::string word = text_in(table.rows[row][outcome]);
    // What has not been run yet is told at the head of the page.
    if (word == "completed" || word == "missing") continue;
    ++counts[word], ++failed;
    // All are counted, the first are listed: a sweep may fail at every point for one reason.
    if (rows.size() < kFailuresListed)
      rows.push_back({text_in(table.rows[row][0]), escape_markup(setting_text(table, varied, row)),
                      text_in(table.rows[row][table.column("seed")]), word,
                      escape_markup(for_terminal(text_in(table.rows[row][reason]), 300)),
                      link_of(table, row, "runs")});
  }
  std::string summary;
  for (const auto& [word, count] : counts)
    summary += fmt::format("{}{} {}", summary.empty() ? "" : ", ", count, word);
  if (summary.empty()) return "";
  return "<p>" + summary + (rows.size() < failed ? "; the first are listed" : "") + "</p>\n" +
         html_table({"point", "setting", "seed", "outcome", "reason", ""},
                    {true, false, true, false, false, false}, rows);
}

/// Wall times of the machines that ran the points: what a longer sweep will take.
std::string slowest(const SweepTable& table, const std::vector<VariedColumn>& varied) {
  std::vector<std::size_t> order;
  std::vector<double> times;
  for (std::size_t row = 0; row < table.rows.size(); ++row)
    // Without a wall time: killed, or not run.
    if (std::isfinite(table.wall_times[row]))
      order.push_back(row), times.push_back(table.wall_times[row]);
  if (order.empty()) return "";
  const std::size_t shown = std::min(order.size(), kSlowest);
  // Ten of ten thousand: not all of them need an order.
  std::partial_sort(
      order.begin(), order.begin() + static_cast<std::ptrdiff_t>(shown), order.end(),
      [&table](std::size_t a, std::size_t b) { return table.wall_times[a] > table.wall_times[b]; });
  std::vector<double> longest;
  for (std::size_t i = 0; i < shown; ++i) longest.push_back(table.wall_times[order[i]]);
  // One unit for the column, as the times stand one above the other.
  const ShownColumn printed = show_column(longest, "s");
  std::vector<std::vector<std::string>> rows;
  for (std::size_t i = 0; i < shown; ++i)
    rows.push_back({text_in(table.rows[order[i]][0]),
                    escape_markup(setting_text(table, varied, order[i])),
                    text_in(table.rows[order[i]][table.column("seed")]), printed.numbers[i],
                    link_of(table, order[i], "runs")});
  // Of processors and not of the sweep: points ran side by side.
  double all = 0;
  for (const double time : times) all += time;
  return fmt::format("<p>{} together, median {}</p>\n", format_quantity(all, "s"),
                     format_quantity(spread_of(times).median, "s")) +
         html_table({"point", "setting", "seed", "took (" + printed.unit + ")", ""},
                    {true, false, true, true, false}, rows);
}

/// What was asked: values of what was varied, and what was fixed.
std::string asked(const nlohmann::json& head) {
  std::vector<std::vector<std::string>> rows;
  for (const nlohmann::json& axis : head.at("axes")) {
    const std::string unit = axis.at("unit");
    std::string values;
    std::size_t count = 0;
    for (const nlohmann::json& value : axis.value("values", nlohmann::json::array())) {
      // Counted on: the text says how many there are in all.
      if (++count > 12) continue;
      values += (values.empty() ? "" : ", ") + (value.is_number()
                                                    ? format_quantity(value.get<double>(), unit, 4)
                                                : value.is_string() ? value.get<std::string>()
                                                                    : value.dump());
    }
    if (count > 12) values += fmt::format(", ... ({} in all)", count);
    // Drawn values are different in every point: their range says what was asked.
    if (axis.contains("drawn"))
      values =
          format_range(axis["drawn"].value("low", 0.0), axis["drawn"].value("high", 0.0), unit) +
          ", " + plural(head.value("draws", std::size_t{0}), "draw") +
          (head.value("draw", "") == "latin" ? " of a Latin hypercube" : " by chance") +
          (axis["drawn"].value("log", false) ? ", logarithmic" : "");
    rows.push_back({escape_markup(axis.at("name").get<std::string>()),
                    axis.value("varied", false) ? "varied" : "fixed", escape_markup(values)});
  }
  return html_table({"parameter", "", "values"}, {false, false, false}, rows);
}

}  // namespace

// The first result in full, the others in one drawing each; then what failed, every setting, what
// was asked, and the slowest.
std::string sweep_report_html(const SweepTable& table, const nlohmann::json& head,
                              const std::string& shown) {
  const std::vector<VariedColumn> varied = varied_columns(table);
  std::vector<std::size_t> results = result_columns(table, shown);
  // A protocol may state dozens of results; the first ones are drawn.
  std::string drawings;
  for (std::size_t i = 0; i < std::min(results.size(), kResultsDrawn); ++i)
    drawings += sweep_figures(table, varied, results[i], i == 0);
  if (!drawings.empty()) drawings = "<div class=\"plots\">\n" + drawings + "</div>\n";
  const std::string sections =
      report_head(table, head, varied) +
      (results.empty() ? "" : extreme_tiles(table, varied, results.front())) + drawings +
      page_section("Failures", failures(table, varied)) +
      page_section("Settings: median, and quartiles of the repeats",
                   settings_table(table, varied, results)) +
      "<div class=\"columns\">" + page_section("What was asked", asked(head)) +
      page_section("The slowest", slowest(table, varied)) + "</div>\n";
  return filled_page({.title = "Sweep: " + head.at("protocol").value("title", ""),
                      .sections = sections,
                      .foot = "Every point, and every digit: sweep.csv and sweep.sqlite (SI units)",
                      .style = kStyle});
}

/// Replaced as a whole: a browser finds the old page or the new one.
void write_sweep_report(const SweepTable& table, const PointFolder& folder,
                        const std::string& shown) {
  publish(folder.folder() / "report.html", sweep_report_html(table, folder.head(), shown));
}

}  // namespace vitreo
