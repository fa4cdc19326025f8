// Layout of a plot: margins, box, ranges, ticks and legend, decided before anything is drawn.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/plot/plot.h"
#include "host/plot/plot_axes.h"
#include "host/plot/plot_series.h"

#include <string>
#include <string_view>
#include <vector>

namespace vitreo {

// px
constexpr double kSwatch = 22;
constexpr double kLegendLine = 17;
constexpr double kLegendText = 11.5;

struct Box {
  double left = 0;
  double top = 0;
  double width = 0;
  double height = 0;
  double right() const { return left + width; }
  double bottom() const { return top + height; }
};

/// Everything that has been decided before anything is drawn.
struct Drawing {
  const Plot& plot;  // borrowed from the caller
  double width = 0;
  double height = 0;
  Box box{};
  Range x{};
  Range y{};
  Ticks x_ticks{};
  Ticks y_ticks{};
  std::vector<std::vector<Stroke>> strokes{};  // per series, in the axes' units
  std::vector<Pen> pens{};
  bool legend_beside = false;
  bool empty = true;

  /// px of a value of the axes' units, or of its logarithm where the axis is logarithmic.
  double px(double value) const { return box.left + (value - x.low) / x.span() * box.width; }
  double py(double value) const { return box.bottom() - (value - y.low) / y.span() * box.height; }
};

/// Throws std::invalid_argument for an unknown unit or series of unequal length. The drawing
/// borrows the plot.
Drawing lay_out_plot(const Plot& plot, int width, int height);
/// A value in SI on the axis: divided by its unit, its base-10 logarithm where that is shown; a NaN
/// where there is none.
double on_axis(const Axis& axis, double value);
/// How much of `height` the plot makes use of: less where a view with equal axes is broad.
int needed_height(const Plot& plot, int width, int height);

bool has_legend(const Plot& plot);
/// Where each label of a legend in rows stands, from (0, 0); `height` takes what they need.
std::vector<PlotPoint> legend_places(const Plot& plot, double width, double* height);

/// The text, cut with an ellipsis where it would be wider than `width`; sizes in px.
std::string fitted(std::string_view text, double size, double width);

}  // namespace vitreo
