// Plots as data, drawn as self-contained SVG for the report and as a file.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

namespace vitreo {

enum class Mark { line, dashed, points };

struct Series {
  std::string label;         // shown in the legend; empty = not in it
  std::vector<double> x, y;  // SI; equally long; a NaN breaks a line
  Mark mark = Mark::line;
};

struct Axis {
  std::string label;  // "error"
  std::string unit;   // as shown, "um"; values are divided by its factor
};

/// One pair of axes.
struct Plot {
  std::string title;
  Axis x, y;
  bool equal_aspect = false;  // trajectory views: a millimeter is as long in both directions
  std::vector<Series> series;
  std::string note;  // one line below, e.g. where the data come from
};

}  // namespace vitreo
