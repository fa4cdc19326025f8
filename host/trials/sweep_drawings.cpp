// SPDX-License-Identifier: Apache-2.0
#include "host/trials/sweep_drawings.h"

#include "host/plot/heat_map.h"
#include "host/plot/plot_svg.h"
#include "host/plot/spread_plot.h"
#include "host/text/columns.h"
#include "host/text/markup.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numeric>

namespace vitreo {
namespace {

constexpr int kHalfFigure = 456;  // px, as in the report of a run
constexpr int kWholeFigure = 929;
constexpr int kFigureHeight = 300;
constexpr std::size_t kCurves = 6;  // that can be told apart
constexpr const char* kSpreadNote = "medians; bars from quartile to quartile of the repeats";

std::string figure(const std::string& svg, bool wide) {
  return fmt::format("<figure{}>{}</figure>\n", wide ? " class=\"wide\"" : "", svg);
}

/// Every completed row.
std::vector<std::size_t> all_rows(const SweepTable& table) { return group_rows(table, {}).front(); }

/// The unit of a result, as a plot takes it.
/// By all rows, so that every drawing of a result has the same unit.
std::string shown_unit(const SweepTable& table, std::size_t result) {
  const std::string& dimension = table.columns[result].unit;
  const auto unit = column_unit(numbers_of(table, result, all_rows(table)), dimension);
  return unit ? std::string(unit->symbol) : "";
}

/// Over which other parameters a drawing was summed up.
std::string over_text(const std::vector<VariedColumn>& varied,
                      const std::vector<const VariedColumn*>& drawn) {
  std::string text;
  for (const VariedColumn& one : varied)
    if (std::find(drawn.begin(), drawn.end(), &one) == drawn.end())
      text += (text.empty() ? "; over all of " : ", ") + one.name;
  return text;
}

/// Even factors between numbers, or words: equal steps on the axis.
bool in_steps(const VariedColumn& column) {
  if (!column.numeric) return true;
  const double low = number_in(column.values.front());
  const double high = number_in(column.values.back());
  // So many labels fit below an axis. Values are ascending; beyond a factor of five the small ones
  // would crowd at its begin.
  return column.values.size() <= 16 && low > 0 && high > 5 * low;
}

/// On an axis of steps a value stands at its number.
double x_of(const VariedColumn& column, std::size_t value) {
  return in_steps(column) ? static_cast<double>(value) : number_in(column.values[value]);
}

/// A setting without a completed run is a NaN, which is a gap in the line.
void add_spread(SpreadSeries& series, double x, const Spread& spread) {
  series.x.push_back(x);
  series.middle.push_back(spread.median);
  series.low.push_back(spread.low);
  series.high.push_back(spread.high);
}

/// Lines of a result along one parameter, one for each value of another (`by` may be null).
std::string lines_svg(const SweepTable& table, const std::vector<VariedColumn>& varied,
                      std::size_t result, const VariedColumn& along, const VariedColumn* by,
                      int width) {
  SpreadPlot plot;
  const std::string& name = table.columns[result].name;
  plot.title = name + " along " + along.name;
  plot.x = {along.name, along.unit};
  plot.y = {name, shown_unit(table, result)};
  if (in_steps(along)) {
    plot.steps = along.labels;
    plot.x = {along.title(), ""};
  }
  std::vector<const VariedColumn*> drawn{&along};
  if (by != nullptr) drawn.insert(drawn.begin(), by);
  const auto groups = group_rows(table, drawn);
  // Of the groups the last column, `along`, changes fastest.
  const std::size_t curves = by == nullptr ? 1 : by->values.size();
  for (std::size_t curve = 0; curve < curves; ++curve) {
    SpreadSeries series;
    if (by != nullptr)
      series.label = fmt::format("{} {}{}{}", by->name, by->labels[curve],
                                 by->unit.empty() ? "" : " ", print_unit(by->unit));
    for (std::size_t i = 0; i < along.values.size(); ++i)
      add_spread(series, x_of(along, i),
                 spread_of(numbers_of(table, result, groups[curve * along.values.size() + i])));
    plot.series.push_back(std::move(series));
  }
  plot.note = kSpreadNote + over_text(varied, drawn);
  return to_svg(plot, width, kFigureHeight);
}

/// `most`: runs of the fullest cell; one with fewer says how many it has.
HeatCell heat_cell(const Spread& spread, std::size_t most, const Unit* unit) {
  if (spread.count == 0) return {std::nan(""), "none", ""};
  const auto shown = [unit](double value) {
    return unit != nullptr ? value / unit->factor : value;
  };
  HeatCell cell{shown(spread.median), format_number(shown(spread.median)), ""};
  if (spread.count > 1)
    cell.below = "\u00b1 " + format_number(shown(spread.high - spread.low) / 2, 2);
  if (spread.count < most)
    cell.below += fmt::format("{}n = {}", cell.below.empty() ? "" : ", ", spread.count);
  return cell;
}

/// A result over two parameters; over all others its runs are taken together.
std::string map_svg(const SweepTable& table, const std::vector<VariedColumn>& varied,
                    std::size_t result, const VariedColumn& x, const VariedColumn& y) {
  const std::string symbol = shown_unit(table, result);
  const auto unit = find_unit(symbol);
  HeatMap map;
  map.unit = print_unit(symbol);
  map.title = table.columns[result].name + (map.unit.empty() ? "" : " (" + map.unit + ")");
  map.x_label = x.title();
  map.y_label = y.title();
  map.columns = x.labels;
  map.rows = y.labels;
  // Row by row as a HeatMap has its cells: x changes fastest, the least y is the lowest row.
  const auto groups = group_rows(table, {&y, &x});
  std::size_t most = 0;
  for (const auto& rows : groups) most = std::max(most, rows.size());
  for (const auto& rows : groups)
    map.cells.push_back(
        heat_cell(spread_of(numbers_of(table, result, rows)), most, unit ? &*unit : nullptr));
  map.note = "medians \u00b1 half the distance between the quartiles of the repeats" +
             over_text(varied, {&x, &y});
  const int height = std::clamp(140 + 56 * static_cast<int>(y.values.size()), 260, 560);
  return to_svg(map, kWholeFigure, height);
}

/// Of drawn values: each run a point.
std::string cloud_of(const SweepTable& table, std::size_t result, const VariedColumn& along,
                     const VariedColumn* by, int width) {
  Plot plot;
  const std::string& name = table.columns[result].name;
  plot.title = name + " over " + along.name;
  plot.x = {along.name, along.unit};
  plot.y = {name, shown_unit(table, result)};
  const auto groups = group_rows(table, by == nullptr ? std::vector<const VariedColumn*>{}
                                                      : std::vector<const VariedColumn*>{by});
  for (std::size_t group = 0; group < groups.size(); ++group) {
    Series series;
    series.mark = Mark::points;
    if (by != nullptr)
      series.label =
          by->name + " " + by->labels[group] + (by->unit.empty() ? "" : " " + print_unit(by->unit));
    for (const std::size_t row : groups[group]) {
      series.x.push_back(number_in(table.rows[row][along.column]));
      series.y.push_back(number_in(table.rows[row][result]));
    }
    plot.series.push_back(std::move(series));
  }
  plot.note = "each run a point";
  return to_svg(plot, width, kFigureHeight);
}

/// Without anything varied: every run by its seed.
std::string seeds_svg(const SweepTable& table, std::size_t result, int width) {
  Plot plot;
  plot.title = table.columns[result].name;
  plot.x = {"point", ""};
  plot.y = {table.columns[result].name, shown_unit(table, result)};
  Series series;
  series.mark = Mark::points;
  for (const std::size_t row : all_rows(table)) {
    series.x.push_back(static_cast<double>(row));
    series.y.push_back(number_in(table.rows[row][result]));
  }
  plot.series.push_back(std::move(series));
  plot.note = "each run a point";
  return to_svg(plot, width, kFigureHeight);
}

/// The parameter that tells lines apart: the first other one with few values.
const VariedColumn* lines_by(const std::vector<VariedColumn>& varied, const VariedColumn& along) {
  for (const VariedColumn& one : varied)
    if (&one != &along && !one.drawn && one.values.size() <= kCurves) return &one;
  return nullptr;
}

/// A cloud of what was drawn, lines along what was stepped.
std::string one_svg(const SweepTable& table, const std::vector<VariedColumn>& varied,
                    std::size_t result, const VariedColumn& along, int width) {
  const VariedColumn* const by = lines_by(varied, along);
  return along.drawn ? cloud_of(table, result, along, by, width)
                     : lines_svg(table, varied, result, along, by, width);
}

}  // namespace

// Two of half the width stand beside each other; an odd one is followed by an empty figure, which
// keeps the next row a row.
std::string sweep_figures(const SweepTable& table, const std::vector<VariedColumn>& varied,
                          std::size_t result, bool whole) {
  if (numbers_of(table, result, all_rows(table)).empty()) return "";
  if (varied.empty())
    return figure(seeds_svg(table, result, whole ? kWholeFigure : kHalfFigure), whole);
  // Numbers before words along the axis.
  std::vector<const VariedColumn*> order;
  for (const VariedColumn& one : varied) order.push_back(&one);
  std::stable_partition(order.begin(), order.end(), [](const auto* one) { return one->numeric; });
  if (!whole) return figure(one_svg(table, varied, result, *order.front(), kHalfFigure), false);
  std::string figures;
  // A map needs values that come back, which drawn ones do not.
  if (order.size() > 1 && !order[0]->drawn && !order[1]->drawn)
    figures += figure(map_svg(table, varied, result, *order[0], *order[1]), true);
  const bool single = order.size() == 1;
  for (const VariedColumn* along : order)
    figures +=
        figure(one_svg(table, varied, result, *along, single ? kWholeFigure : kHalfFigure), single);
  if (!single && order.size() % 2 == 1) figures += "<figure></figure>\n";
  return figures;
}

}  // namespace vitreo
