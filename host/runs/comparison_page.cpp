// Page of a comparison: plots over each other, and the tables.
// SPDX-License-Identifier: Apache-2.0
#include "host/plot/plot_series.h"
#include "host/plot/plot_svg.h"
#include "host/runs/comparison.h"
#include "host/runs/report_page.h"
#include "host/text/columns.h"
#include "host/text/markup.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

namespace vitreo {
namespace {

constexpr int kHalf = 456;  // CSS px, as in the report of a run
constexpr int kWhole = 929;
constexpr std::size_t kOpenPlots = 4;  // of the streams; the others are folded

constexpr const char* kComparisonStyle =
    ".runs { display: flex; flex-wrap: wrap; gap: 8px 14px; margin: 12px 0 0; }\n"
    ".run { border: 1px solid var(--line); border-radius: 14px; padding: 4px 12px; font-size: "
    "14px; }\n"
    ".swatch { display: inline-block; width: 12px; height: 12px; border-radius: 3px; margin-right: "
    "7px; vertical-align: -1px; }\n"
    ".lead { border: 1px solid var(--line); border-radius: 8px; padding: 14px 18px; margin: 18px 0 "
    "0; background: var(--wash); }\n"
    ".lead b { display: block; font-size: 19px; } .lead span { color: var(--soft); }\n"
    "td.n, th.n { text-align: right; white-space: nowrap; }\n";

/// A channel of a stream in one run.
std::optional<std::size_t> channel_named(const Stream& stream, const std::string& name) {
  for (std::size_t i = 0; i < stream.info.channels.size(); ++i)
    if (stream.info.channels[i].name == name) return i;
  return std::nullopt;
}

/// Against the run's own clock, which begins at zero in each.
Series series_of(const Stream& stream, std::size_t channel) {
  Series series;
  for (std::size_t row = 0; row < stream.times.size(); ++row) {
    series.x.push_back(to_seconds(stream.times[row]));
    // What was not measured is a NaN, and a gap in the line.
    series.y.push_back(stream.at(row, channel));
  }
  return series;
}

/// Distance from where the loop was told to hold the robot; empty where the stream has no such
/// channels.
Series distance_of(const Stream& stream) {
  constexpr std::array kAxes{"x", "y", "z"};
  std::array<std::size_t, 3> is{};
  std::array<std::size_t, 3> wanted{};
  for (std::size_t i = 0; i < 3; ++i) {
    const auto place = channel_named(stream, kAxes[i]);
    const auto target = channel_named(stream, std::string("target_") + kAxes[i]);
    if (!place || !target) return {};
    is[i] = *place, wanted[i] = *target;
  }
  Series series;
  for (std::size_t row = 0; row < stream.times.size(); ++row) {
    double square = 0;
    for (std::size_t i = 0; i < 3; ++i)
      square += std::pow(stream.at(row, is[i]) - stream.at(row, wanted[i]), 2);
    series.x.push_back(to_seconds(stream.times[row]));
    series.y.push_back(std::sqrt(square));
  }
  return series;
}

/// The unit in which all of them are shown.
std::string unit_for(const std::vector<Series>& all, const std::string& dimension) {
  std::vector<double> ends;
  for (const Series& one : all)
    for (const double value : one.y)
      if (drawable(value)) ends.push_back(value);
  if (ends.empty()) return "";
  const auto [least, most] = std::minmax_element(ends.begin(), ends.end());
  const auto unit = column_unit({*least, *most}, dimension);
  return unit ? std::string(unit->symbol) : "";
}

/// One plot of all runs; nothing where fewer than two have data.
/// A run without data keeps an empty series, so that each run has its color on every plot.
std::optional<Plot> overlay(const std::string& title, const std::string& label,
                            const std::string& dimension, std::vector<Series> all,
                            const std::vector<std::string>& names) {
  std::size_t filled = 0;
  for (std::size_t i = 0; i < all.size(); ++i) {
    all[i].label = names[i];
    filled += std::any_of(all[i].y.begin(), all[i].y.end(), drawable) ? 1 : 0;
  }
  // A single line compares nothing.
  if (filled < 2) return std::nullopt;
  Plot plot;
  plot.title = title;
  plot.x = {"experiment time", "s"};
  plot.y = {label, unit_for(all, dimension)};
  plot.series = std::move(all);
  return plot;
}

/// Steps of the target are far above all else: what is beyond the usual stands at the upper edge,
/// and the note says how far it went.
void cut_peaks(Plot& plot) {
  constexpr double kUsual = 0.97;  // of the values
  constexpr double kPeak = 4;      // times that: then there are peaks
  constexpr double kRoom = 1.5;    // times that is shown
  // overlay() has seen to it that there are values.
  std::vector<double> values;
  for (const Series& one : plot.series)
    std::copy_if(one.y.begin(), one.y.end(), std::back_inserter(values), drawable);
  std::sort(values.begin(), values.end());
  const double usual =
      values[static_cast<std::size_t>(kUsual * static_cast<double>(values.size() - 1))];
  if (!(values.back() > kPeak * usual)) return;
  for (Series& one : plot.series)
    for (double& value : one.y)
      // A NaN is not above it, and stays a gap.
      if (value > kRoom * usual) value = kRoom * usual;
  plot.note =
      "peaks are cut at the upper edge; the largest is " + format_quantity(values.back(), "m");
}

/// By the streams of the first run: others have nothing to be laid over.
std::vector<Plot> distances(const std::vector<RunData>& runs,
                            const std::vector<std::string>& names) {
  std::vector<Plot> plots;
  for (const Stream& stream : runs.front().streams) {
    std::vector<Series> all;
    for (const RunData& run : runs) {
      const Stream* const same = run.stream(stream.info.name);
      all.push_back(same == nullptr ? Series{} : distance_of(*same));
    }
    if (auto plot = overlay("Distance from the target, by " + stream.info.name, "distance", "m",
                            std::move(all), names)) {
      cut_peaks(*plot);
      // Once more: without the peaks a smaller unit may fit.
      plot->y.unit = unit_for(plot->series, "m");
      plots.push_back(std::move(*plot));
    }
  }
  return plots;
}

/// Every channel of the first run's streams that another run has, too.
std::vector<Plot> channels(const std::vector<RunData>& runs,
                           const std::vector<std::string>& names) {
  std::vector<Plot> plots;
  for (const Stream& stream : runs.front().streams)
    for (const Channel& channel : stream.info.channels) {
      std::vector<Series> all;
      for (const RunData& run : runs) {
        const Stream* const same = run.stream(stream.info.name);
        const auto place = same == nullptr ? std::nullopt : channel_named(*same, channel.name);
        all.push_back(place ? series_of(*same, *place) : Series{});
      }
      if (auto plot = overlay(stream.info.name + ": " + channel.name, channel.name, channel.unit,
                              std::move(all), names))
        plots.push_back(std::move(*plot));
    }
  return plots;
}

std::string figures(const std::vector<Plot>& plots, std::size_t from, std::size_t to) {
  std::string out;
  for (std::size_t i = from; i < to; ++i)
    out += "<figure>" + to_svg(plots[i], kHalf, 250) + "</figure>\n";
  return out.empty() ? "" : "<div class=\"plots\">\n" + out + "</div>\n";
}

/// The distances in full, the first channels open, all others folded.
std::string drawings(const std::vector<RunData>& runs, const std::vector<std::string>& names) {
  std::string out;
  for (const Plot& plot : distances(runs, names))
    out += "<div class=\"plots\"><figure class=\"wide\">" + to_svg(plot, kWhole, 300) +
           "</figure></div>\n";
  const std::vector<Plot> all = channels(runs, names);
  const std::size_t open = std::min(all.size(), kOpenPlots);
  out += figures(all, 0, open);
  if (open < all.size())
    out += fmt::format("<details><summary>{} more channels</summary>{}</details>\n",
                       all.size() - open, figures(all, open, all.size()));
  return out;
}

/// `two`: the cell of the difference is there also where it is empty, so that all rows of a table
/// have as many.
std::string one_row(const char* tag, const ComparedLine& line, bool two) {
  std::string row = fmt::format("<tr><{0}>{1}</{0}>", tag, escape_markup(line.name));
  for (const std::string& cell : line.cells)
    row += fmt::format("<{0} class=\"n\">{1}</{0}>", tag, escape_markup(cell));
  if (two)
    row += fmt::format("<{0} class=\"n\"><b>{1}</b></{0}>", tag, escape_markup(line.difference));
  return row + "</tr>\n";
}

std::string lines_table(const std::vector<ComparedLine>& lines,
                        const std::vector<std::string>& names, bool differences) {
  if (lines.empty()) return "<p>nothing</p>\n";
  ComparedLine head{"", names, differences ? "B \u2212 A" : ""};
  std::string out =
      "<div class=\"scroll\"><table><thead>" + one_row("th", head, differences) + "</thead><tbody>";
  for (const ComparedLine& line : lines) out += one_row("td", line, differences);
  return out + "</tbody></table></div>\n";
}

/// The first result in words, and what it may not be taken for.
std::string lead(const RunComparison& made) {
  std::string first;
  // The first that every run states: beside a dash there is nothing to compare.
  const auto whole = std::find_if(made.results.begin(), made.results.end(), [](const auto& line) {
    return std::find(line.cells.begin(), line.cells.end(), "\u2013") == line.cells.end();
  });
  if (whole != made.results.end()) {
    const ComparedLine& line = *whole;
    first = line.name + ": ";
    for (std::size_t i = 0; i < line.cells.size(); ++i)
      first += fmt::format("{}{} in {}", i == 0 ? "" : ", ", line.cells[i], made.names[i]);
    if (!line.difference.empty()) first += " (" + line.difference + ")";
  }
  std::string names;
  for (const ComparedLine& line : made.differing) names += (names.empty() ? "" : ", ") + line.name;
  const std::string differs =
      names.empty() ? "Nothing that was asked differs." : "What differs: " + names + ".";
  return "<div class=\"lead\"><b>" + escape_markup(first) + "</b><span>" + escape_markup(differs) +
         " One run each: a difference is not yet shown to be more than chance; vitreo sweep with "
         "--repeat shows the spread.</span></div>\n";
}

/// Which color is which run: the pens of the plots, in the same order.
std::string chips(const std::vector<RunData>& runs, const std::vector<std::string>& names) {
  std::vector<Series> lines(runs.size());
  const std::vector<Pen> pens = pens_for(lines);
  std::string out = "<div class=\"runs\">";
  for (std::size_t i = 0; i < runs.size(); ++i)
    out += fmt::format(
        "<span class=\"run\"><span class=\"swatch\" style=\"background: {}\"></span><b>{}</b> "
        "{}</span>",
        pens[i].color, names[i], escape_markup(runs[i].folder.filename().string()));
  return out + "</div>\n";
}

}  // namespace

std::string comparison_html(const std::vector<RunData>& runs) {
  const RunComparison made = compare_runs(runs);
  const bool two = runs.size() == 2;
  std::string same;
  for (const std::string& name : made.same) same += (same.empty() ? "" : ", ") + name;
  const std::string sections =
      fmt::format("<header><h1>Compare {} runs</h1></header>\n", runs.size()) +
      chips(runs, made.names) + lead(made) + drawings(runs, made.names) +
      "<div class=\"columns\"><section><h2>Results</h2>" +
      lines_table(made.results, made.names, two) + "</section>\n<section><h2>What differs</h2>" +
      lines_table(made.differing, made.names, false) +
      (same.empty() ? "" : "<p>The same: " + escape_markup(same) + ".</p>") + "</section></div>\n";
  return filled_page({.title = fmt::format("Compare {} runs", runs.size()),
                      .sections = sections,
                      .foot = "Every digit is in each run's run.sqlite (SI units)",
                      .style = kComparisonStyle});
}

}  // namespace vitreo
