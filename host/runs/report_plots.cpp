// Plots of the report: two of a kind side by side, each with what its script reads and its data.
// SPDX-License-Identifier: Apache-2.0
#include "host/plot/plot_layout.h"
#include "host/plot/plot_svg.h"
#include "host/runs/report_parts.h"
#include "host/text/markup.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace vitreo {
namespace {

// CSS px of the drawings, which the page stretches by 1.2: on paper their letters are then still of
// 6 pt.
constexpr int kHalfWidth = 456;
constexpr int kWholeWidth = 929;
constexpr int kPlotHeight = 270;
constexpr int kViewHeight = 400;

// JSON has neither NaN nor infinity: null is what cannot be drawn, as an end that is open.
nlohmann::json number_or_null(double value) {
  return drawable(value) ? nlohmann::json(value) : nlohmann::json(nullptr);
}

/// What the page's script needs to read and zoom the plot: box in px, ranges, names, pens.
nlohmann::json reading_of(const Drawing& drawing) {
  const Plot& plot = drawing.plot;
  nlohmann::json names = nlohmann::json::array(), pens = names, expected = names;
  for (std::size_t i = 0; i < plot.series.size(); ++i) {
    names.push_back(plot.series[i].label);
    const Pen& pen = drawing.pens[i];
    pens.push_back(
        {{"color", pen.color}, {"dashes", pen.dashes}, {"points", pen.mark == Mark::points}});
  }
  for (const Expected& one : plot.expected)
    expected.push_back({number_or_null(on_axis(plot.y, one.low)),
                        number_or_null(on_axis(plot.y, one.high)), one.label});
  return {{"size", {drawing.width, drawing.height}},
          {"box", {drawing.box.left, drawing.box.top, drawing.box.width, drawing.box.height}},
          {"x", {drawing.x.low, drawing.x.high}},
          {"y", {drawing.y.low, drawing.y.high}},
          {"log", {plot.x.logarithmic, plot.y.logarithmic}},
          {"labels",
           {axis_title(plot.x.label, plot.x.unit, 0), axis_title(plot.y.label, plot.y.unit, 0)}},
          {"equal", plot.equal_aspect},
          {"names", names},
          {"pens", pens},
          {"expected", expected}};
}

/// Of letters that every system takes as a file's name.
std::string file_name_of(const std::string& title) {
  std::string name;
  for (const char c : title)
    name += (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') ? c : '_';
  return (name.empty() ? "plot" : name) + ".csv";
}

std::string plot_figure(const Plot& plot, int width, int height) {
  const char* wide = width == kWholeWidth ? " class=\"wide\"" : "";
  const Drawing drawing = lay_out_plot(plot, width, height);
  if (drawing.empty)
    return fmt::format("<figure{}>{}</figure>\n", wide, to_svg(plot, width, height));
  // As a data URL the table travels with the page, and its script reads the values from there: they
  // are in the page once.
  const std::string csv = plot_csv(plot);
  const std::vector<unsigned char> bytes(csv.begin(), csv.end());
  // A name that is no UTF-8 would throw here, and one plot cost the whole report: its bytes are
  // replaced.
  const std::string reading =
      reading_of(drawing).dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
  return fmt::format(
      "<figure{} data-plot=\"{}\">{}<figcaption><a download=\"{}\" "
      "href=\"data:text/csv;base64,{}\">Data (CSV)</a> <span class=\"how\" hidden=\"\">drag: zoom "
      "\u00b7 "
      "double click: all \u00b7 click a name: off and on</span></figcaption></figure>\n",
      wide, escape_markup(reading), to_svg(plot, width, height), file_name_of(plot.title),
      base64(bytes));
}

/// As an image: what a script drew can neither run nor disturb the page.
std::string drawing_figure(const SvgDrawing& drawing) {
  const std::vector<unsigned char> bytes(drawing.svg.begin(), drawing.svg.end());
  return "<figure class=\"wide\"><img alt=\"" + escape_markup(drawing.title) +
         "\" src=\"data:image/svg+xml;base64," + base64(bytes) + "\"></figure>\n";
}

/// A trajectory view is as tall as its shape asks for, within reason.
int figure_height(const Plot& plot) {
  return plot.equal_aspect
             ? std::clamp(needed_height(plot, kHalfWidth, kViewHeight), 260, kViewHeight)
             : kPlotHeight;
}

}  // namespace

// Nine digits are more than any instrument has; a value that is none is an empty cell.
std::string plot_csv(const Plot& plot) {
  const auto unit = [](const Axis& axis) {
    const auto found = find_unit(axis.unit);
    return found ? found->factor : 1;
  };
  const auto cell = [](double value) {
    return std::isfinite(value) ? fmt::format("{:.9g}", value) : std::string();
  };
  const auto name = [](const Axis& axis) {
    std::string text = axis_title(axis.label, axis.unit, 0);
    // A comma or a line's end in a name would begin another cell or row.
    std::replace(text.begin(), text.end(), ',', ';');
    std::replace(text.begin(), text.end(), '\n', ' ');
    return text;
  };
  const double x = unit(plot.x), y = unit(plot.y);
  std::string csv = "series," + name(plot.x) + "," + name(plot.y) + ",half bar\n";
  for (std::size_t i = 0; i < plot.series.size(); ++i) {
    const Series& one = plot.series[i];
    for (std::size_t k = 0; k < std::min(one.x.size(), one.y.size()); ++k)
      csv += fmt::format("{},{},{},{}\n", i, cell(one.x[k] / x), cell(one.y[k] / y),
                         k < one.spread.size() ? cell(one.spread[k] / y) : "");
  }
  return csv;
}

// A lonely plot against time takes the whole width, a lonely view half of it.
std::string report_plots(const RunData& data) {
  const std::vector<Plot>& plots = data.plots;
  std::string out;
  for (const SvgDrawing& drawing : data.drawings) out += drawing_figure(drawing);
  for (std::size_t i = 0; i < plots.size();) {
    const bool paired = i + 1 < plots.size() && plots[i].equal_aspect == plots[i + 1].equal_aspect;
    const int height = std::max(figure_height(plots[i]), paired ? figure_height(plots[i + 1]) : 0);
    out +=
        plot_figure(plots[i], paired || plots[i].equal_aspect ? kHalfWidth : kWholeWidth, height);
    if (paired) out += plot_figure(plots[i + 1], kHalfWidth, height);
    if (!paired && plots[i].equal_aspect) out += "<figure></figure>\n";  // keeps the next row a row
    i += paired ? 2 : 1;
  }
  return out.empty() ? "" : "<div class=\"plots\">\n" + out + "</div>\n";
}

}  // namespace vitreo
