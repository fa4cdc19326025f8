// Series of a plot on their way to pixels: units, gaps, and thinning below what is visible.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/plot/plot.h"
#include "host/plot/plot_axes.h"

#include <string>
#include <vector>

namespace vitreo {

struct PlotPoint {
  double x;
  double y;
};
using Stroke = std::vector<PlotPoint>;  // points joined without a gap

/// The series cut at every value that cannot be drawn, in the axes' units. Throws
/// std::invalid_argument for unequal lengths.
std::vector<Stroke> strokes_of(const Series& series, double x_factor, double y_factor);

/// At most four points for each visit to a pixel column (first, lowest, highest, last, in their
/// order): no extreme is lost.
Stroke thinned(const Stroke& pixels);

/// Points of which no two fall in the same cell of `cell` px: for clouds. The data are whole in the
/// report's table; only the drawing is thinned.
Stroke thinned_cloud(const Stroke& pixels, double cell = 0.5);

/// How one series is drawn.
struct Pen {
  // dashes: empty for a full line
  std::string color;
  std::string dashes;
  double width = 1.6;
  Mark mark = Mark::line;
};
/// Colors that color-blind readers can distinguish (Okabe and Ito), in the order of the series; the
/// first dashed one is dark gray, as references are.
std::vector<Pen> pens_for(const std::vector<Series>& series);

/// A bar in px: from `low` to `high` at x, with a cap at either end.
struct Bar {
  double x;
  double low;
  double high;
};
std::string bars_svg(const std::vector<Bar>& bars, const Pen& pen);

/// One series as SVG elements; coordinates in px.
std::string series_svg(const std::vector<Stroke>& pixels, const Pen& pen);
/// Its sample in the legend.
std::string swatch_svg(double x, double y, double width, const Pen& pen);

}  // namespace vitreo
