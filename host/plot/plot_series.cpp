// SPDX-License-Identifier: Apache-2.0
#include "host/plot/plot_series.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <set>
#include <stdexcept>

namespace vitreo {
namespace {

// Okabe and Ito (2008) in an order of falling contrast on white; gray stands for their yellow,
// which white swallows.
constexpr std::array kColors = {"#0072B2", "#D55E00", "#009E73", "#CC79A7",
                                "#E69F00", "#56B4E9", "#222222", "#999999"};
constexpr std::array kDashes = {"", "7 3", "2 3", "9 3 2 3"};
constexpr const char* kReferenceColor = "#4A4F55";

// A tenth of a pixel is below what is visible: more digits only make the file larger.
std::string path_data(const Stroke& stroke) {
  std::string data;
  for (const PlotPoint& point : stroke) {
    data += fmt::format("{}{:.1f} {:.1f}", data.empty() ? "M" : "L", point.x, point.y);
  }
  return data;
}

std::string dot(const PlotPoint& point, double radius) {
  return fmt::format("<circle cx=\"{:.1f}\" cy=\"{:.1f}\" r=\"{}\"/>", point.x, point.y, radius);
}

// Hollow: a line below them, and points of another series, stay in sight. A crowd is drawn thinned
// and smaller.
std::string cloud_svg(const std::vector<Stroke>& pixels, const Pen& pen) {
  constexpr std::size_t kCrowd = 150;
  Stroke all;
  for (const Stroke& stroke : pixels) all.insert(all.end(), stroke.begin(), stroke.end());
  const bool crowd = all.size() > kCrowd;
  const double radius = crowd ? 2 : 3.2;
  std::string svg = fmt::format("<g fill=\"none\" stroke=\"{}\" stroke-width=\"{}\">", pen.color,
                                crowd ? 1 : 1.4);
  for (const PlotPoint& point : thinned_cloud(all, crowd ? 5 : 0.5)) svg += dot(point, radius);
  return svg + "</g>";
}

}  // namespace

// What cannot be drawn (NaN, infinite) cuts the line: a gap in the data is a gap in the plot.
// Never ends with an empty stroke; a value that stands alone between gaps is a stroke of one point,
// drawn as a dot.
std::vector<Stroke> strokes_of(const Series& series, double x_factor, double y_factor) {
  if (series.x.size() != series.y.size()) {
    throw std::invalid_argument(fmt::format("series \"{}\" has {} x values and {} y values",
                                            series.label, series.x.size(), series.y.size()));
  }
  std::vector<Stroke> strokes(1);
  for (std::size_t i = 0; i < series.x.size(); ++i) {
    const PlotPoint point{series.x[i] / x_factor, series.y[i] / y_factor};
    if (drawable(point.x) && drawable(point.y)) {
      strokes.back().push_back(point);
    } else if (!strokes.back().empty()) {
      strokes.emplace_back();
    }
  }
  if (strokes.back().empty()) strokes.pop_back();
  return strokes;
}

// Of each column of pixels the first, lowest, highest and last point, in their order: a line
// through them covers the same pixels as one through all (M4: Jugel et al., VLDB 2014).
Stroke thinned(const Stroke& pixels) {
  Stroke result;
  for (std::size_t start = 0; start < pixels.size();) {
    const double column = std::floor(pixels[start].x);
    std::size_t end = start + 1;
    std::size_t low = start;
    std::size_t high = start;
    // Visits and not columns: a curve that comes back to a column (a trajectory) is thinned in each
    // visit, so that its order stays.
    for (; end < pixels.size() && std::floor(pixels[end].x) == column; ++end) {
      if (pixels[end].y < pixels[low].y) low = end;
      if (pixels[end].y > pixels[high].y) high = end;
    }
    std::array<std::size_t, 4> kept = {start, std::min(low, high), std::max(low, high), end - 1};
    for (std::size_t i = 0; i < kept.size(); ++i) {
      if (i == 0 || kept[i] != kept[i - 1]) result.push_back(pixels[kept[i]]);
    }
    start = end;
  }
  return result;
}

// The first point in each cell.
Stroke thinned_cloud(const Stroke& pixels, double cell) {
  std::set<std::pair<double, double>> taken;
  Stroke result;
  for (const PlotPoint& point : pixels) {
    if (taken.emplace(std::floor(point.x / cell), std::floor(point.y / cell)).second)
      result.push_back(point);
  }
  return result;
}

// Colors first; after the last of them the dashes change. 300 points: lines and dots become finer.
// By the places in the list alone, so that a picture and its legend agree. The reference takes no
// color away from the data.
std::vector<Pen> pens_for(const std::vector<Series>& series) {
  std::vector<Pen> pens;
  std::size_t next = 0;
  bool reference_taken = false;
  for (const Series& one : series) {
    const bool reference = one.mark == Mark::dashed && !reference_taken;
    reference_taken = reference_taken || reference;
    Pen pen;
    pen.mark = one.mark;
    pen.color = reference ? kReferenceColor : kColors[next % kColors.size()];
    pen.dashes = one.mark == Mark::dashed ? "5 4" : kDashes[next / kColors.size() % kDashes.size()];
    pen.width = reference ? 1.4 : one.x.size() > 300 ? 1.2 : 1.6;
    if (!reference) ++next;
    pens.push_back(std::move(pen));
  }
  return pens;
}

std::string series_svg(const std::vector<Stroke>& pixels, const Pen& pen) {
  if (pen.mark == Mark::points) return cloud_svg(pixels, pen);
  std::string data;
  std::string lonely;
  for (const Stroke& stroke : pixels) {
    if (stroke.size() == 1) {
      lonely += dot(stroke.front(), pen.width);
    } else {
      data += path_data(thinned(stroke));
    }
  }
  std::string svg;
  if (!data.empty()) {
    svg = fmt::format(
        "<path fill=\"none\" stroke=\"{}\" stroke-width=\"{}\" stroke-linejoin=\"round\"",
        pen.color, pen.width);
    svg += pen.dashes.empty() ? " stroke-linecap=\"round\""
                              : fmt::format(" stroke-dasharray=\"{}\"", pen.dashes);
    svg += fmt::format(" d=\"{}\"/>", data);
  }
  if (!lonely.empty()) svg += fmt::format("<g fill=\"{}\">{}</g>", pen.color, lonely);
  return svg;
}

std::string bars_svg(const std::vector<Bar>& bars, const Pen& pen) {
  constexpr double kCap = 3.5;  // px to either side
  std::string data;
  for (const Bar& bar : bars)
    data += fmt::format("M{0:.1f} {1:.1f}H{2:.1f}M{3:.1f} {1:.1f}V{4:.1f}M{0:.1f} {4:.1f}H{2:.1f}",
                        bar.x - kCap, bar.high, bar.x + kCap, bar.x, bar.low);
  if (data.empty()) return "";
  return fmt::format("<path fill=\"none\" stroke=\"{}\" stroke-width=\"1.2\" d=\"{}\"/>", pen.color,
                     data);
}

// Thicker than in the plot: a color is hard to tell on a thin line.
std::string swatch_svg(double x, double y, double width, const Pen& pen) {
  if (pen.mark == Mark::points) return cloud_svg({{{x + width / 2, y}}}, pen);
  Pen thick = pen;
  thick.width = 2;
  return series_svg({{{x, y}, {x + width, y}}}, thick);
}

}  // namespace vitreo
