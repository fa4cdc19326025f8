// Parts of SVG that all drawings share: texts, lines, the root element.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/plot/plot_style.h"

#include <string>
#include <string_view>

namespace vitreo {

struct TextStyle {
  double size = 11.5;
  const char* anchor = "start";
  const char* color = kInk;
  const char* extra = "";  // attributes
};

/// Escaped: a label may hold any text of a script.
std::string text_svg(double x, double y, std::string_view text, const TextStyle& style);
std::string line_svg(double x1, double y1, double x2, double y2, const char* color);
/// Where a line of one pixel is sharp: its middle lies in the middle of a pixel.
double crisp(double px);

/// Opens the element, with a white ground. No ids and no style sheet: many drawings stand in one
/// page and must not disturb each other.
std::string open_svg(double width, double height, std::string_view title);

}  // namespace vitreo
