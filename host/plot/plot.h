// Plots as data, drawn as self-contained SVG for the report and as a file.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <limits>
#include <string>
#include <vector>

namespace vitreo {

enum class Mark { line, dashed, points };

struct Series {
  std::string label;         // shown in the legend; empty = not in it
  std::vector<double> x, y;  // SI; equally long; a NaN breaks a line
  Mark mark = Mark::line;
  std::vector<double> spread{};  // half-length of each point's bar along y, SI; empty: no bars
};

struct Axis {
  std::string label;         // "error"
  std::string unit;          // as shown, "um"; values are divided by its factor
  bool logarithmic = false;  // decades; what is not positive is not drawn
};

/// A value or a range along y that was expected: a dashed line, or a shaded band between dashed
/// edges. An end that is infinite is the plot's.
struct Expected {
  std::string label;  // stands in the plot: "thesis: 266 ± 184 µm"
  double low;         // SI; equal to `high` for a line
  double high;
};

/// Words in the plot: at a point, or, where y is NaN, at the top of a dotted line at x.
struct Annotation {
  std::string text;
  double x;  // SI
  double y = std::numeric_limits<double>::quiet_NaN();
};

/// One pair of axes.
struct Plot {
  std::string title;
  Axis x, y;
  bool equal_aspect = false;  // trajectory views: a millimeter is as long in both directions
  std::vector<Series> series;
  std::string note;  // one line below, e.g. where the data come from
  std::vector<Expected> expected{};
  std::vector<Annotation> annotations{};
};

}  // namespace vitreo
