// Spread plot: lines through medians with bars for their spread, as self-contained SVG.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/plot/plot.h"

#include <string>
#include <vector>

namespace vitreo {

/// Equally long; SI. A NaN in `middle` is a gap.
struct SpreadSeries {
  std::string label;
  std::vector<double> x;
  std::vector<double> middle;
  std::vector<double> low;
  std::vector<double> high;
};

struct SpreadPlot {
  std::string title;
  Axis x;
  Axis y;
  /// Where they are given, x counts them from 0, and the axis has these labels: choices, or values
  /// with even factors between them.
  std::vector<std::string> steps;
  std::vector<SpreadSeries> series;
  std::string note;  // one line below
};

/// Throws std::invalid_argument for unequal lengths or an unknown unit.
std::string to_svg(const SpreadPlot& plot, int width, int height);

}  // namespace vitreo
