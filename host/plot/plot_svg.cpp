// SPDX-License-Identifier: Apache-2.0
#include "host/plot/plot_svg.h"

#include "host/plot/plot_layout.h"
#include "host/plot/plot_style.h"
#include "host/plot/svg_parts.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace vitreo {
namespace {

constexpr const char* kGrid = "#E7EAED";
constexpr const char* kZero = "#B4BCC4";

// The zero line is darker where values of both signs are shown; in a trajectory's view zero is no
// special place.
std::string grid_svg(const Drawing& drawing) {
  const Box& box = drawing.box;
  std::string svg;
  for (double tick : drawing.x_ticks.at) {
    const double x = crisp(drawing.px(tick));
    svg += line_svg(x, box.top, x, box.bottom(), kGrid);
  }
  for (double tick : drawing.y_ticks.at) {
    const double y = crisp(drawing.py(tick));
    const bool zero =
        tick == 0 && drawing.y.low < 0 && !drawing.plot.equal_aspect && !drawing.plot.y.logarithmic;
    svg += line_svg(box.left, y, box.right(), y, zero ? kZero : kGrid);
  }
  return svg;
}

std::string axes_svg(const Drawing& drawing) {
  const Box& box = drawing.box;
  // Lines of one px between pixels would be gray and two wide: crisp() moves them into one.
  const double left = crisp(box.left);
  const double bottom = crisp(box.bottom());
  std::string svg = line_svg(left, box.top, left, bottom, kSpine) +
                    line_svg(left, bottom, box.right(), bottom, kSpine);
  const TextStyle below{11, "middle", kSoftInk, ""}, beside{11, "end", kSoftInk, ""};
  for (std::size_t i = 0; i < drawing.x_ticks.at.size(); ++i) {
    const double x = crisp(drawing.px(drawing.x_ticks.at[i]));
    svg += line_svg(x, bottom, x, bottom + 4, kSpine) +
           text_svg(x, bottom + 17, drawing.x_ticks.labels[i], below);
  }
  for (std::size_t i = 0; i < drawing.y_ticks.at.size(); ++i) {
    const double y = crisp(drawing.py(drawing.y_ticks.at[i]));
    svg += line_svg(left - 4, y, left, y, kSpine) +
           text_svg(left - 7, y + 4, drawing.y_ticks.labels[i], beside);
  }
  return svg;
}

std::string axis_titles_svg(const Drawing& drawing) {
  const Box& box = drawing.box;
  const TextStyle centered{12, "middle", kInk, ""};
  const std::string x =
      axis_title(drawing.plot.x.label, drawing.plot.x.unit, drawing.x_ticks.exponent);
  const std::string y =
      axis_title(drawing.plot.y.label, drawing.plot.y.unit, drawing.y_ticks.exponent);
  std::string svg = text_svg(box.left + box.width / 2, box.bottom() + 36,
                             fitted(x, 12, drawing.width - 20), centered);
  return svg + fmt::format("<g transform=\"translate(17 {:.1f}) rotate(-90)\">{}</g>",
                           box.top + box.height / 2,
                           text_svg(0, 0, fitted(y, 12, drawing.height - 10), centered));
}

// Above the box in rows, or beside it in a column, as the layout has decided.
std::string legend_svg(const Drawing& drawing) {
  const Plot& plot = drawing.plot;
  double height = 0;
  std::vector<PlotPoint> places = legend_places(plot, drawing.box.width, &height);
  const double x0 = drawing.legend_beside ? drawing.box.right() + 18 : drawing.box.left;
  const double y0 = drawing.legend_beside ? drawing.box.top + 10 : drawing.box.top - height + 4;
  double row = 0;
  std::string svg;
  for (std::size_t i = 0; i < plot.series.size(); ++i) {
    if (plot.series[i].label.empty()) continue;
    const PlotPoint place = drawing.legend_beside ? PlotPoint{0, kLegendLine * row++} : places[i];
    // Up to the right edge of the drawing: fitted() shortens a name that is longer.
    const double room = drawing.width - x0 - place.x - kSwatch - 8;
    // The report's script switches a series by its name.
    svg += fmt::format("<g data-key=\"{}\">", i) +
           swatch_svg(x0 + place.x, y0 + place.y - 4, kSwatch, drawing.pens[i]) +
           text_svg(x0 + place.x + kSwatch + 6, y0 + place.y,
                    fitted(plot.series[i].label, 11.5, room), {}) +
           "</g>";
  }
  return svg;
}

/// The bars of a series in px, within the box.
std::vector<Bar> bars_of(const Drawing& drawing, const Series& series) {
  std::vector<Bar> bars;
  for (std::size_t i = 0; i < series.spread.size(); ++i) {
    const double x = drawing.px(on_axis(drawing.plot.x, series.x[i]));
    double low = drawing.py(on_axis(drawing.plot.y, series.y[i] - series.spread[i]));
    const double high = drawing.py(on_axis(drawing.plot.y, series.y[i] + series.spread[i]));
    // On a logarithmic axis a bar that reaches zero goes down to the foot.
    if (!drawable(low) && drawing.plot.y.logarithmic) low = drawing.box.bottom();
    // In px, which grow downward: the low end of a bar is the greater number.
    if (drawable(x) && drawable(low) && drawable(high))
      bars.push_back({x, std::min(low, drawing.box.bottom()), std::max(high, drawing.box.top)});
  }
  return bars;
}

std::string data_svg(const Drawing& drawing) {
  if (drawing.empty) {
    return text_svg(drawing.box.left + drawing.box.width / 2,
                    drawing.box.top + drawing.box.height / 2 + 5, "no data",
                    {14, "middle", kSoftInk, ""});
  }
  // Points below lines, and references on top: thin and broken, they hide nothing.
  std::string points, lines, dashed;
  for (std::size_t i = 0; i < drawing.strokes.size(); ++i) {
    // A copy: thinning works in pixels, and the layout keeps the axes' units.
    std::vector<Stroke> pixels = drawing.strokes[i];
    for (Stroke& stroke : pixels) {
      for (PlotPoint& point : stroke) point = {drawing.px(point.x), drawing.py(point.y)};
    }
    const Pen& pen = drawing.pens[i];
    (pen.mark == Mark::points   ? points
     : pen.mark == Mark::dashed ? dashed
                                : lines) +=
        fmt::format("<g data-series=\"{}\">{}{}</g>", i,
                    bars_svg(bars_of(drawing, drawing.plot.series[i]), pen),
                    series_svg(pixels, pen));
  }
  return points + lines + dashed;
}

/// A band within the box, its edges dashed; its words at the right, above the upper edge where
/// there is room.
std::string expected_svg(const Drawing& drawing) {
  constexpr const char* kBand = "#E9DFCB";
  constexpr const char* kEdge = "#8F5A00";
  const Box& box = drawing.box;
  const auto inside = [&](double value, double otherwise) {
    const double at = on_axis(drawing.plot.y, value);
    return drawable(at) ? std::clamp(drawing.py(at), box.top, box.bottom()) : otherwise;
  };
  std::string svg;
  for (const Expected& one : drawing.plot.expected) {
    const double top = inside(one.high, box.top), foot = inside(one.low, box.bottom());
    // Less than half a pixel is a value, not a band: its edge is drawn alone.
    if (foot - top > 0.5)
      svg += fmt::format(
          "<rect x=\"{:.1f}\" y=\"{:.1f}\" width=\"{:.1f}\" height=\"{:.1f}\" fill=\"{}\" "
          "fill-opacity=\"0.6\"/>",
          box.left, top, box.width, foot - top, kBand);
    // An edge at the border of the box is open or out of sight: a line there would be a false
    // bound.
    for (const double edge : {top, foot})
      if (edge > box.top && edge < box.bottom())
        svg += fmt::format(
            "<path d=\"M{:.1f} {:.1f}H{:.1f}\" stroke=\"{}\" stroke-width=\"1.2\" "
            "stroke-dasharray=\"6 4\"/>",
            box.left, edge, box.right(), kEdge);
    const double base = top - 5 > box.top + 9 ? top - 5 : std::min(top + 14, box.bottom() - 4);
    svg += text_svg(box.right() - 5, base, fitted(one.label, 11, box.width - 10),
                    {11, "end", kEdge, " font-weight=\"600\""});
  }
  return svg;
}

/// Phases as dotted lines with their names at the top, words at points.
std::string annotations_svg(const Drawing& drawing) {
  const Box& box = drawing.box;
  std::string svg;
  for (const Annotation& one : drawing.plot.annotations) {
    const double x = drawing.px(on_axis(drawing.plot.x, one.x));
    // This form drops NaN too, as of a place at or below 0 on a logarithmic axis.
    if (!(x >= box.left - 0.5 && x <= box.right() + 0.5)) continue;
    // In the last quarter words stand to the left of their place: else they would leave the box.
    const bool late = x > box.left + 0.75 * box.width;
    const TextStyle style{10.5, late ? "end" : "start", kSoftInk, ""};
    const double at = x + (late ? -4 : 4), y = drawing.py(on_axis(drawing.plot.y, one.y));
    if (drawable(y)) {
      svg += text_svg(at, std::clamp(y - 6, box.top + 9, box.bottom() - 3), one.text, style);
      continue;
    }
    svg +=
        fmt::format("<path d=\"M{:.1f} {:.1f}V{:.1f}\" stroke=\"{}\" stroke-dasharray=\"1.5 3\"/>",
                    x, box.top, box.bottom(), kSoftInk);
    svg += text_svg(at, box.top + 10, one.text, style);
  }
  return svg;
}

}  // namespace

std::string to_svg(const Plot& plot, int width, int height) {
  const Drawing drawing = lay_out_plot(plot, width, height);
  std::string svg = open_svg(drawing.width, drawing.height, plot.title);
  if (!plot.title.empty()) {
    svg += text_svg(drawing.box.left, 21,
                    fitted(plot.title, 13.5, drawing.width - drawing.box.left - 12),
                    {13.5, "start", kInk, " font-weight=\"600\""});
  }
  if (!drawing.empty)  // What the report's script draws anew when it zooms.
    svg += "<g data-fixed=\"\">" + expected_svg(drawing) + grid_svg(drawing) + axes_svg(drawing) +
           annotations_svg(drawing) + "</g>";
  if (drawing.empty) {
    svg += fmt::format(
        "<rect x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\" fill=\"#F7F8F9\" stroke=\"{}\"/>",
        crisp(drawing.box.left), crisp(drawing.box.top), std::floor(drawing.box.width),
        std::floor(drawing.box.height), kGrid);
  }
  // Data come after grid and bands, and so on top of them.
  svg += axis_titles_svg(drawing) + data_svg(drawing);
  if (has_legend(plot)) svg += legend_svg(drawing);
  if (!plot.note.empty()) {
    svg += text_svg(drawing.box.left, drawing.box.bottom() + 56,
                    fitted(plot.note, 10.5, drawing.width - drawing.box.left - 8),
                    {10.5, "start", kSoftInk, ""});
  }
  return svg + "</svg>";
}

}  // namespace vitreo
