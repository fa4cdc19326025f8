// SPDX-License-Identifier: Apache-2.0
#include "host/plot/plot_layout.h"

#include "host/text/markup.h"
#include "host/text/units.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace vitreo {
namespace {

/// An estimate, for layout: the mean advance of Helvetica and its likes.
/// No fonts are loaded, since the renderer chooses its own. Three classes of letters are enough for
/// margins; the continuation bytes of UTF-8 have no width.
double text_width(std::string_view text, double size) {
  double width = 0;
  for (char c : text) {
    if ((static_cast<unsigned char>(c) & 0xC0) == 0x80) continue;
    const bool narrow = std::string_view("iljtfr.,:;|'()[] ").find(c) != std::string_view::npos;
    width += narrow ? 0.32 : (c >= 'A' && c <= 'Z') || c == 'm' || c == 'w' ? 0.76 : 0.56;
  }
  return width * size;
}

// Values are SI and the axis is in its unit. An unknown one is an error of the script, at its line.
double factor_of(const Axis& axis) {
  const auto unit = find_unit(axis.unit);
  if (!unit)
    throw std::invalid_argument("axis \"" + axis.label + "\": \"" + axis.unit + "\" is not a unit");
  return unit->factor;
}

/// The decades of a logarithmic axis: as positions along it, what is not positive being no
/// position.
void take_logarithms(const Plot& plot, std::vector<Stroke>& strokes) {
  if (!plot.x.logarithmic && !plot.y.logarithmic) return;
  std::vector<Stroke> taken;
  for (const Stroke& stroke : strokes) {
    taken.emplace_back();
    for (PlotPoint point : stroke) {
      if (plot.x.logarithmic) point.x = point.x > 0 ? std::log10(point.x) : std::nan("");
      if (plot.y.logarithmic) point.y = point.y > 0 ? std::log10(point.y) : std::nan("");
      if (drawable(point.x) && drawable(point.y))
        taken.back().push_back(point);
      else if (!taken.back().empty())
        taken.emplace_back();
    }
    if (taken.back().empty()) taken.pop_back();
  }
  strokes = std::move(taken);
}

/// Ends of bars, and what was expected, are part of the picture: a goal that the data do not reach,
/// or leave far below, is shown all the same where it is within ten times the data's range.
void include_extras(const Plot& plot, Range& y) {
  if (y.empty()) return;
  for (const Series& one : plot.series)
    for (std::size_t i = 0; i < one.spread.size(); ++i)
      for (const double end : {one.y[i] - one.spread[i], one.y[i] + one.spread[i]})
        if (const double at = on_axis(plot.y, end); drawable(at)) y.include(at);
  const Range data = y;
  const double reach = 10 * std::max(data.span(), std::fabs(data.high));
  for (const Expected& one : plot.expected)
    for (const double end : {one.low, one.high})
      if (const double at = on_axis(plot.y, end);
          drawable(at) && at > data.low - reach && at < data.high + reach)
        y.include(at);
}

double legend_width(const Plot& plot) {
  double width = 0;
  for (const Series& one : plot.series)
    width = std::max(width, kSwatch + 8 + text_width(one.label, kLegendText));
  return width;
}

/// The ranges from the data with their margins, before the shape of the box changes them.
/// Curves touch the left and right end of the box, since time has no margin; clouds get air, or
/// points on the rim would be cut. Views with equal axes get the same air all around.
void choose_ranges(Drawing& drawing) {
  Range x;
  Range y;
  for (const auto& strokes : drawing.strokes) {
    for (const Stroke& stroke : strokes) {
      for (const PlotPoint& point : stroke) {
        x.include(point.x);
        y.include(point.y);
      }
    }
  }
  drawing.empty = x.empty();
  include_extras(drawing.plot, y);
  if (drawing.plot.equal_aspect) {
    drawing.x = padded(x, 0.06, false);
    drawing.y = padded(y, 0.06, false);
    return;
  }
  const auto& series = drawing.plot.series;
  const bool cloud = std::any_of(series.begin(), series.end(),
                                 [](const Series& s) { return s.mark == Mark::points; });
  drawing.x = cloud ? padded(x, 0.03, false) : widened(x);
  drawing.y = padded(y, 0.05, !drawing.plot.y.logarithmic);
}

/// Gives the box the shape of the data; a sliver is widened by showing more of the surroundings.
/// One scale for both axes, the smaller of the two that fit; the box shrinks to it. `least`: each
/// side keeps at least 0.35 of its room, where a sliver would have no ticks.
void make_equal(Drawing& drawing) {
  Box& box = drawing.box;
  const auto widen_to = [](Range& range, double span) {
    const double middle = (range.low + range.high) / 2;
    range = {middle - span / 2, middle + span / 2};
  };
  const double least = 0.35 * std::max(drawing.x.span() / box.width, drawing.y.span() / box.height);
  if (drawing.x.span() < least * box.width) widen_to(drawing.x, least * box.width);
  if (drawing.y.span() < least * box.height) widen_to(drawing.y, least * box.height);
  const double scale = std::min(box.width / drawing.x.span(), box.height / drawing.y.span());
  const double spare = box.width - drawing.x.span() * scale;
  box.width = drawing.x.span() * scale;
  box.height = drawing.y.span() * scale;
  drawing.legend_beside = has_legend(drawing.plot) && spare >= legend_width(drawing.plot) + 24;
}

/// Whether x counts (no unit, whole numbers only): then no tick stands half-way between two.
bool counts_along_x(const Drawing& drawing) {
  if (!drawing.plot.x.unit.empty() || drawing.plot.equal_aspect || drawing.plot.x.logarithmic ||
      drawing.empty)
    return false;
  for (const auto& strokes : drawing.strokes)
    for (const Stroke& stroke : strokes)
      for (const PlotPoint& point : stroke)
        if (point.x != std::round(point.x)) return false;
  return true;
}

// A tick every 60 px across and 32 px down: labels of five characters do not touch.
void choose_ticks(Drawing& drawing) {
  double x_step = nice_step(drawing.x.span(), drawing.box.width / 60);
  double y_step = nice_step(drawing.y.span(), drawing.box.height / 32);
  // One step for both axes, unless that leaves the short axis of a sliver without ticks.
  if (drawing.plot.equal_aspect) {
    x_step = nice_step(drawing.x.span(), drawing.box.width / 58);
    y_step = std::min(x_step, nice_step(drawing.y.span(), 3));
    x_step = std::min(x_step, nice_step(drawing.x.span(), 3));
  }
  if (counts_along_x(drawing)) x_step = std::max(x_step, 1.0);
  const bool log_x = drawing.plot.x.logarithmic, log_y = drawing.plot.y.logarithmic;
  if (!drawing.plot.equal_aspect && !log_x) drawing.x = snapped(drawing.x, x_step);
  drawing.x_ticks =
      log_x ? make_decades(drawing.x, drawing.box.width / 60) : make_ticks(drawing.x, x_step);
  drawing.y_ticks =
      log_y ? make_decades(drawing.y, drawing.box.height / 32) : make_ticks(drawing.y, y_step);
}

/// Room for tick labels, the axis' title and the note.
double below_box(const Plot& plot) { return 44 + (plot.note.empty() ? 0 : 18); }

/// The box that is left between tick labels, titles and legend.
void lay_out(Drawing& drawing, bool legend_on_top) {
  const Plot& plot = drawing.plot;
  double labels = 0;
  for (const std::string& label : drawing.y_ticks.labels)
    labels = std::max(labels, text_width(label, 11));
  double legend = 0;
  const double left = 30 + labels + 6;
  const double right = 16;
  if (legend_on_top) legend_places(plot, drawing.width - left - right, &legend);
  const double top = 10 + (plot.title.empty() ? 4 : 22) + (legend > 0 ? legend + 6 : 0);
  drawing.box = {left, top, drawing.width - left - right,
                 std::max(40.0, drawing.height - top - below_box(plot))};
}

}  // namespace

bool has_legend(const Plot& plot) {
  return std::any_of(plot.series.begin(), plot.series.end(),
                     [](const Series& one) { return !one.label.empty(); });
}

// Row by row from the left, as text is set; a label never breaks. Series without a label have a
// place of no width, so that places and series have the same index.
std::vector<PlotPoint> legend_places(const Plot& plot, double width, double* height) {
  std::vector<PlotPoint> places;
  double x = 0;
  double y = 0;
  for (const Series& one : plot.series) {
    const double needed =
        one.label.empty() ? 0 : kSwatch + 8 + text_width(one.label, kLegendText) + 16;
    if (x > 0 && x + needed > width + 16) {
      x = 0;
      y += kLegendLine;
    }
    places.push_back({x, y});
    x += needed;
  }
  *height = has_legend(plot) ? y + kLegendLine : 0;
  return places;
}

// One letter's width is kept for the ellipsis. At least one character stays.
std::string fitted(std::string_view text, double size, double width) {
  if (text_width(text, size) <= width) return std::string(text);
  std::size_t count = count_characters(text);
  while (count > 1 && text_width(first_characters(text, count), size) > width - size) --count;
  return std::string(first_characters(text, count)) + "\u2026";
}

Drawing lay_out_plot(const Plot& plot, int width, int height) {
  Drawing drawing{plot};
  drawing.width = std::max(width, 200);
  drawing.height = std::max(height, 140);
  const double x_factor = factor_of(plot.x);
  const double y_factor = factor_of(plot.y);
  for (const Series& one : plot.series) {
    drawing.strokes.push_back(strokes_of(one, x_factor, y_factor));
    take_logarithms(plot, drawing.strokes.back());
    if (!one.spread.empty() && one.spread.size() != one.y.size())
      throw std::invalid_argument("series \"" + one.label + "\": as many bars as points");
  }
  drawing.pens = pens_for(plot.series);
  choose_ranges(drawing);
  // The margin depends on the tick labels and they on the box: the second pass settles it. A
  // trajectory's legend moves beside it where there is room, which the first pass (without a legend
  // on top) finds out.
  const Range x = drawing.x;
  const Range y = drawing.y;
  bool on_top = !plot.equal_aspect;
  // Three are enough: the legend may move once, and the margins follow.
  for (int pass = 0; pass < 3; ++pass) {
    drawing.x = x;
    drawing.y = y;
    lay_out(drawing, on_top);
    if (plot.equal_aspect) make_equal(drawing);
    choose_ticks(drawing);
    if (plot.equal_aspect) on_top = on_top || !drawing.legend_beside;
  }
  drawing.legend_beside = plot.equal_aspect && !on_top;
  return drawing;
}

double on_axis(const Axis& axis, double value) {
  const double shown = value / factor_of(axis);
  if (!axis.logarithmic) return shown;
  return shown > 0 ? std::log10(shown) : std::nan("");
}

// Laid out in full: with equal axes the height follows from the data's shape.
int needed_height(const Plot& plot, int width, int height) {
  const Drawing drawing = lay_out_plot(plot, width, height);
  return static_cast<int>(std::ceil(drawing.box.bottom() + below_box(plot)));
}

}  // namespace vitreo
