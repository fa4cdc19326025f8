// Heat map: a number for each pair of settings as a color, with the number in the cell, as
// self-contained SVG.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

namespace vitreo {

struct HeatCell {
  double value = 0;   // in the unit shown; NaN: nothing came out, and the cell is crossed
  std::string text;   // "53"
  std::string below;  // "± 4"; may be empty
};

struct HeatMap {
  std::string title;
  std::string x_label;  // with unit: "speed (mm/s)"
  std::string y_label;
  std::string unit;                  // of the cells, as printed
  std::vector<std::string> columns;  // one label each, from the left
  std::vector<std::string> rows;     // from below
  std::vector<HeatCell> cells;       // row by row, from below
  std::string note;                  // one line below
};

/// Colors from yellow (least) to violet (most), by the logarithm where the values span more than a
/// factor of three. Throws std::invalid_argument where the number of cells does not fit.
std::string to_svg(const HeatMap& map, int width, int height);

}  // namespace vitreo
