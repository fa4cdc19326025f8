// SPDX-License-Identifier: Apache-2.0
#include "host/plot/heat_map.h"

#include "host/plot/plot_axes.h"
#include "host/plot/plot_layout.h"
#include "host/plot/svg_parts.h"
#include "host/text/units.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>

namespace vitreo {
namespace {

using Color = std::array<double, 3>;

// viridis of Smith and van der Walt (2015), CC0, at tenths: even steps of lightness, also for the
// color-blind and in gray.
constexpr std::array<Color, 11> kViridis{{{68, 1, 84},
                                          {72, 35, 116},
                                          {64, 67, 135},
                                          {52, 94, 141},
                                          {41, 120, 142},
                                          {32, 144, 140},
                                          {34, 167, 132},
                                          {68, 190, 112},
                                          {121, 209, 81},
                                          {189, 222, 38},
                                          {253, 231, 37}}};

constexpr double kGap = 2;           // px between cells
constexpr double kTextWidth = 46;    // px that a cell needs for its number
constexpr double kTextHeight = 18;   // likewise
constexpr double kBelowHeight = 34;  // with a second line

/// `share`: 0 the least, 1 the most.
/// The table goes from violet to yellow, the scale from yellow to violet.
Color color_at(double share) {
  const double place = (1 - std::clamp(share, 0.0, 1.0)) * static_cast<double>(kViridis.size() - 1);
  const auto below = std::min(static_cast<std::size_t>(place), kViridis.size() - 2);
  Color mixed{};
  for (std::size_t i = 0; i < 3; ++i)
    mixed[i] =
        std::lerp(kViridis[below][i], kViridis[below + 1][i], place - static_cast<double>(below));
  return mixed;
}

std::string hex(const Color& color) {
  return fmt::format("#{:02X}{:02X}{:02X}", std::lround(color[0]), std::lround(color[1]),
                     std::lround(color[2]));
}

/// Relative luminance (WCAG 2.2) decides which ink can be read on it.
const char* ink_on(const Color& color) {
  const auto linear = [](double part) {
    part /= 255;
    return part <= 0.04045 ? part / 12.92 : std::pow((part + 0.055) / 1.055, 2.4);
  };
  const double luminance =
      0.2126 * linear(color[0]) + 0.7152 * linear(color[1]) + 0.0722 * linear(color[2]);
  // Where black and white have the same contrast: (L + 0.05)^2 = 0.05 * 1.05 at L = 0.179.
  return luminance > 0.18 ? "#06130E" : "#FFFFFF";
}

/// From values to shares of the scale.
struct Scale {
  Range range{};
  bool logarithmic = false;
  double share(double value) const {
    // One value alone, or none.
    if (!(range.span() > 0)) return 0;
    return logarithmic ? std::log(value / range.low) / std::log(range.high / range.low)
                       : (value - range.low) / range.span();
  }
};

/// Of all cells that have a value.
Scale scale_of(const HeatMap& map) {
  Scale scale;
  for (const HeatCell& cell : map.cells)
    if (drawable(cell.value)) scale.range.include(cell.value);
  // A value that is zero or below has no logarithm.
  scale.logarithmic = scale.range.low > 0 && scale.range.high > 3 * scale.range.low;
  return scale;
}

/// One drawing: the room for labels is decided first, the cells share what is left.
class Drawer {
 public:
  Drawer(const HeatMap& map, int width, int height)
      : map_(map), scale_(scale_of(map)), width_(width), height_(height) {
    std::size_t longest = 1;
    for (const std::string& row : map.rows) longest = std::max(longest, row.size());
    // 40 px for the title of the axis and its air, 6.2 px for each letter of 11 px.
    box_ = {40 + 6.2 * static_cast<double>(std::min<std::size_t>(longest, 16)), 36, 0, 0};
    box_.width = width - box_.left - 12;
    box_.height = height - box_.top - (map.note.empty() ? 74 : 90);
    cell_width_ = box_.width / static_cast<double>(std::max<std::size_t>(map.columns.size(), 1));
    cell_height_ = box_.height / static_cast<double>(std::max<std::size_t>(map.rows.size(), 1));
  }
  std::string svg() const {
    std::string svg = open_svg(width_, height_, map_.title);
    svg += text_svg(box_.left, 21, fitted(map_.title, 13.5, width_ - box_.left - 12),
                    {13.5, "start", kInk, " font-weight=\"600\""});
    for (std::size_t row = 0; row < map_.rows.size(); ++row)
      for (std::size_t column = 0; column < map_.columns.size(); ++column) svg += cell(row, column);
    return svg + labels() + legend() + "</svg>";
  }

 private:
  /// Number and second line only where they fit; a cell without a value is crossed.
  std::string cell(std::size_t row, std::size_t column) const {
    const HeatCell& cell = map_.cells[row * map_.columns.size() + column];
    const double x = box_.left + cell_width_ * static_cast<double>(column);
    const double y = box_.bottom() - cell_height_ * static_cast<double>(row + 1);
    // In a map of many cells the gap shrinks with them.
    const double gap = std::min({kGap, cell_width_ / 8, cell_height_ / 8});
    const double w = cell_width_ - gap;
    const double h = cell_height_ - gap;
    const bool there = drawable(cell.value);
    const Color color = color_at(there ? scale_.share(cell.value) : 0);
    std::string svg = fmt::format(
        "<rect x=\"{:.1f}\" y=\"{:.1f}\" width=\"{:.1f}\" height=\"{:.1f}\" rx=\"2\" fill=\"{}\"/>",
        x, y, w, h, there ? hex(color) : "#EEF0F2");
    if (!there)
      svg += line_svg(x + 3, y + 3, x + w - 3, y + h - 3, "#AAB1B8") +
             line_svg(x + 3, y + h - 3, x + w - 3, y + 3, "#AAB1B8");
    if (w < kTextWidth || h < kTextHeight) return svg;
    const bool two = !cell.below.empty() && h >= kBelowHeight;
    const char* const ink = there ? ink_on(color) : kInk;
    const double middle = x + w / 2;
    // A ground for the word, so that the cross does not run through it.
    if (!there && !cell.text.empty())
      svg += fmt::format(
          "<rect x=\"{:.1f}\" y=\"{:.1f}\" width=\"{:.1f}\" height=\"18\" "
          "fill=\"#EEF0F2\"/>",
          x + 4, y + h / 2 - 9, w - 8);
    svg += text_svg(middle, y + h / 2 + (two ? -1 : 5), fitted(cell.text, 13, w - 4),
                    {13.0, "middle", ink, " font-weight=\"600\""});
    if (two)
      svg += text_svg(middle, y + h / 2 + 14, fitted(cell.below, 10.5, w - 4),
                      {10.5, "middle", ink, ""});
    return svg;
  }

  /// Each n-th label, so that none touches the next.
  std::string labels() const {
    std::string svg;
    std::size_t longest = 1;
    for (const std::string& column : map_.columns) longest = std::max(longest, column.size());
    const double wanted = 6.4 * static_cast<double>(std::min<std::size_t>(longest, 14)) + 8;
    const auto every = static_cast<std::size_t>(std::ceil(wanted / cell_width_));
    const auto rows_every = static_cast<std::size_t>(std::ceil(14 / cell_height_));
    for (std::size_t i = 0; i < map_.columns.size(); i += every)
      svg += text_svg(box_.left + cell_width_ * (static_cast<double>(i) + 0.5), box_.bottom() + 15,
                      fitted(map_.columns[i], 11, cell_width_ * static_cast<double>(every)),
                      {11, "middle", kSoftInk, ""});
    for (std::size_t i = 0; i < map_.rows.size(); i += rows_every)
      svg +=
          text_svg(box_.left - 7, box_.bottom() - cell_height_ * (static_cast<double>(i) + 0.5) + 4,
                   fitted(map_.rows[i], 11, box_.left - 34), {11, "end", kSoftInk, ""});
    svg += text_svg(box_.left + box_.width / 2, box_.bottom() + 34,
                    fitted(map_.x_label, 12, box_.width), {12, "middle", kInk, ""});
    return svg + fmt::format("<g transform=\"translate(17 {:.1f}) rotate(-90)\">{}</g>",
                             box_.top + box_.height / 2,
                             text_svg(0, 0, fitted(map_.y_label, 12, box_.height),
                                      {12, "middle", kInk, ""}));
  }

  /// Ends of the scale, the colors between them, and the sign for what is empty.
  std::string legend() const {
    const double y = box_.bottom() + 46;
    std::string svg;
    if (!map_.note.empty())
      svg += text_svg(box_.left, y + 36, fitted(map_.note, 10.5, box_.width),
                      {10.5, "start", kSoftInk, ""});
    if (scale_.range.empty()) return svg;
    const std::string low = format_number(scale_.range.low);
    const double left = box_.left + 7 * static_cast<double>(low.size()) + 6;
    constexpr int kSteps = 48;
    constexpr double kStep = 3;
    svg += text_svg(left - 6, y + 10, low, {11, "end", kSoftInk, ""});
    // A little wider than their distance, so that no seam shows between two.
    for (int i = 0; i < kSteps; ++i)
      svg += fmt::format("<rect x=\"{:.1f}\" y=\"{:.1f}\" width=\"{}\" height=\"12\" fill=\"{}\"/>",
                         left + kStep * i, y, kStep + 0.3, hex(color_at((i + 0.5) / kSteps)));
    const std::string high = format_number(scale_.range.high) +
                             (map_.unit.empty() ? "" : " " + map_.unit) +
                             (scale_.logarithmic ? ", logarithmic" : "");
    svg += text_svg(left + kStep * kSteps + 7, y + 10, high, {11, "start", kSoftInk, ""});
    const bool crossed = std::any_of(map_.cells.begin(), map_.cells.end(),
                                     [](const auto& cell) { return !drawable(cell.value); });
    if (crossed)
      svg += text_svg(box_.right(), y + 10, "\u00d7 no run completed", {11, "end", kSoftInk, ""});
    return svg;
  }

  const HeatMap& map_;
  Scale scale_;
  double width_;
  double height_;
  Box box_{};
  double cell_width_ = 0;
  double cell_height_ = 0;
};

}  // namespace

std::string to_svg(const HeatMap& map, int width, int height) {
  if (map.cells.size() != map.rows.size() * map.columns.size())
    throw std::invalid_argument(fmt::format("heat map: {} cells for {} rows of {}",
                                            map.cells.size(), map.rows.size(), map.columns.size()));
  return Drawer(map, width, height).svg();
}

}  // namespace vitreo
