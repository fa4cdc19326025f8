// SPDX-License-Identifier: Apache-2.0
#include "host/plot/svg_parts.h"

#include "host/text/markup.h"

#include <fmt/format.h>

#include <cmath>

namespace vitreo {

/// A tenth of a px cannot be seen, and more digits would make the page longer.
std::string text_svg(double x, double y, std::string_view text, const TextStyle& style) {
  return fmt::format(
      "<text x=\"{:.1f}\" y=\"{:.1f}\" font-size=\"{}\" text-anchor=\"{}\" fill=\"{}\"{}>{}</text>",
      x, y, style.size, style.anchor, style.color, style.extra, escape_markup(text));
}

std::string line_svg(double x1, double y1, double x2, double y2, const char* color) {
  return fmt::format(
      "<line x1=\"{:.1f}\" y1=\"{:.1f}\" x2=\"{:.1f}\" y2=\"{:.1f}\" stroke=\"{}\"/>", x1, y1, x2,
      y2, color);
}

double crisp(double px) { return std::floor(px) + 0.5; }

std::string open_svg(double width, double height, std::string_view title) {
  return fmt::format(
      // Programs that read a page aloud take the role and the title (WAI-ARIA).
      "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {0} {1}\" width=\"{0}\" "
      "height=\"{1}\" role=\"img\" "
      "font-family=\"Helvetica Neue, Helvetica, Arial, Liberation Sans, sans-serif\">"
      "<title>{2}</title><rect width=\"{0}\" height=\"{1}\" fill=\"#FFFFFF\"/>",
      width, height, escape_markup(title));
}

}  // namespace vitreo
