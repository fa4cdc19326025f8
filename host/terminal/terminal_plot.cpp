// Plot in Braille dots: two by four of them a character, with ticks and names at the axes.
// SPDX-License-Identifier: Apache-2.0
#include "host/plot/plot_axes.h"
#include "host/plot/plot_layout.h"
#include "host/terminal/terminal_picture.h"
#include "host/text/terminal_text.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

namespace vitreo {
namespace {

// Characters at most: a plot as large as a large window would drive what was said before out of it.
constexpr int kMostColumns = 110, kMostRows = 22;
constexpr std::array kSeriesColors{36, 33, 35, 32, 34, 31};  // ANSI: told apart on dark and light
// Without colors the legend tells series apart by a solid line, three dashes and four dashes.
constexpr std::array kSigns{"\u2500", "\u2504", "\u2508"};

/// Dots of one cell in the order of their bits.
constexpr int kDotBits[4][2] = {{0x01, 0x08}, {0x02, 0x10}, {0x04, 0x20}, {0x40, 0x80}};

struct Cell {
  int dots = 0;
  int series = -1;  // the last that drew in it
};

/// Dots of the whole plot, x to the right and y down, (0, 0) in the upper left corner.
/// What falls outside is dropped: a curve that leaves the box is cut at its edge.
class Canvas {
 public:
  Canvas(int columns, int rows)
      : columns_(columns), rows_(rows), cells_(static_cast<std::size_t>(columns * rows)) {}
  int width() const { return columns_ * 2; }
  int height() const { return rows_ * 4; }

  void dot(int x, int y, int series) {
    if (x < 0 || y < 0 || x >= width() || y >= height()) return;
    Cell& cell = cells_[static_cast<std::size_t>(y / 4 * columns_ + x / 2)];
    cell.dots |= kDotBits[y % 4][x % 2];
    cell.series = series;
  }
  // Steps along the longer side, so that no dot of the line is left out.
  void line(PlotPoint a, PlotPoint b, int series) {
    const double steps = std::max({1.0, std::fabs(b.x - a.x), std::fabs(b.y - a.y)});
    for (double i = 0; i <= steps; ++i)
      dot(static_cast<int>(std::lround(a.x + (b.x - a.x) * i / steps)),
          static_cast<int>(std::lround(a.y + (b.y - a.y) * i / steps)), series);
  }
  std::string row(int row, bool colors) const {
    std::string out;
    // U+2800 plus the bits is the sign; in UTF-8 all of them have three bytes.
    // The color is ended after each sign: a line that is cut leaves the terminal as it was.
    for (int column = 0; column < columns_; ++column) {
      const Cell& cell = cells_[static_cast<std::size_t>(row * columns_ + column)];
      const int code = 0x2800 + cell.dots;
      const std::string sign{static_cast<char>(0xE0 | (code >> 12)),
                             static_cast<char>(0x80 | ((code >> 6) & 0x3F)),
                             static_cast<char>(0x80 | (code & 0x3F))};
      const bool colored = colors && cell.series >= 0;
      out += colored
                 ? fmt::format(
                       "\033[{}m{}\033[0m",
                       kSeriesColors[static_cast<std::size_t>(cell.series) % kSeriesColors.size()],
                       sign)
                 : sign;
    }
    return out;
  }

 private:
  int columns_, rows_;
  std::vector<Cell> cells_;
};

/// The axes' ends lie on the outermost dots: hence one less than the width and the height.
void draw(Canvas& canvas, const Drawing& drawing) {
  // Values grow upward, rows of dots downward: y is counted from the high end of its range.
  const auto place = [&](const PlotPoint& point) {
    return PlotPoint{(point.x - drawing.x.low) / drawing.x.span() * (canvas.width() - 1),
                     (drawing.y.high - point.y) / drawing.y.span() * (canvas.height() - 1)};
  };
  for (std::size_t i = 0; i < drawing.strokes.size(); ++i)
    for (const Stroke& stroke : drawing.strokes[i])
      for (std::size_t k = 0; k < stroke.size(); ++k) {
        const bool points = drawing.pens[i].mark == Mark::points;
        const PlotPoint now = place(stroke[k]);
        canvas.line(points || k == 0 ? now : place(stroke[k - 1]), now, static_cast<int>(i));
        // A single dot is hard to see: a point is two by two.
        if (points) canvas.line({now.x + 1, now.y + 1}, {now.x, now.y + 1}, static_cast<int>(i));
        if (points) canvas.line({now.x + 1, now.y}, {now.x + 1, now.y}, static_cast<int>(i));
      }
}

// By columns, not by bytes: a letter beyond ASCII has several bytes and one column.
std::string padded(const std::string& text, std::size_t columns) {
  const std::size_t width = columns_of(text);
  return std::string(width < columns ? columns - width : 0, ' ') + text;
}

/// Tick labels below the canvas, each in the middle below its place, as far as they do not touch.
std::string x_labels(const Ticks& ticks, const Range& range, int columns) {
  // A label that would touch the one before is left out: a number that runs into another is wrong.
  std::string line;
  int written = 0;
  for (std::size_t i = 0; i < ticks.at.size(); ++i) {
    const int width = static_cast<int>(columns_of(ticks.labels[i]));
    const int at =
        static_cast<int>((ticks.at[i] - range.low) / range.span() * (columns - 1)) - width / 2;
    // A label at an end of the axis is moved inward: it would hang over the edge of the canvas.
    const int begin = std::clamp(at, 0, std::max(0, columns - width));
    if (begin < written + (written > 0 ? 1 : 0)) continue;
    line += std::string(static_cast<std::size_t>(begin - written), ' ') + ticks.labels[i];
    written = begin + width;
  }
  return line;
}

/// Without colors the series cannot be told apart in the dots; the names are given all the same.
std::string legend(const Plot& plot, bool colors) {
  std::string line;
  for (std::size_t i = 0; i < plot.series.size(); ++i) {
    if (plot.series[i].label.empty()) continue;
    const std::string name = harmless(plot.series[i].label);
    line += (line.empty() ? "" : "   ") +
            (colors ? fmt::format("\033[{}m\u2500\u2500\033[0m ",
                                  kSeriesColors[i % kSeriesColors.size()])
                    : std::string(kSigns[std::min(i, kSigns.size() - 1)]) + " ") +
            name;
  }
  return line;
}

}  // namespace

std::string plot_text(const Plot& plot, const Screen& screen) {
  const bool colors = screen.graphics != Graphics::braille;
  const int rows = std::clamp(screen.rows * 2 / 3, 6, kMostRows);
  const int wide = std::clamp(screen.columns, 40, kMostColumns);
  // Ranges and ticks are the report's, for a box of as many px as there are dots or so.
  Plot linear = plot;
  // Ticks here are made in equal steps, so that a logarithmic axis is drawn as a linear one; the
  // box has the screen's shape, not the trajectory's.
  linear.x.logarithmic = linear.y.logarithmic = linear.equal_aspect = false;
  const Drawing drawing = lay_out_plot(linear, wide * 9, rows * 18 + 80);
  if (drawing.empty) return "no data\n";
  // A tick each three rows, and each ten columns: room for the longest labels.
  const Ticks y_ticks = make_ticks(drawing.y, nice_step(drawing.y.span(), rows / 3.0));
  // As wide as the widest label: the axis is one straight line.
  std::size_t margin = 0;
  for (const std::string& label : y_ticks.labels) margin = std::max(margin, columns_of(label));
  const int columns = wide - static_cast<int>(margin) - 2;
  const Ticks x_ticks = make_ticks(drawing.x, nice_step(drawing.x.span(), columns / 10.0));
  // Labels and the axis take the margin and two columns.
  Canvas canvas(columns, rows);
  draw(canvas, drawing);
  std::string out;
  if (!plot.title.empty()) out += harmless(plot.title) + "\n";
  out += harmless(axis_title(plot.y.label, plot.y.unit, y_ticks.exponent)) + "\n";
  for (int row = 0; row < rows; ++row) {
    std::string label;
    for (std::size_t i = 0; i < y_ticks.at.size(); ++i) {
      // A tick stands in the row that is nearest to its value, at most half a row or two dots off.
      const double at = (drawing.y.high - y_ticks.at[i]) / drawing.y.span() * (rows - 1);
      if (std::lround(at) == row) label = y_ticks.labels[i];
    }
    out += padded(label, margin) + (label.empty() ? " \u2502" : " \u2524") +
           canvas.row(row, colors) + "\n";
  }
  const std::string indent(margin + 2, ' ');
  out += indent + x_labels(x_ticks, drawing.x, columns) + "\n";
  const std::string name = harmless(axis_title(plot.x.label, plot.x.unit, x_ticks.exponent));
  const std::string names = legend(plot, colors);
  if (!name.empty() || !names.empty())
    out += indent + name + (name.empty() || names.empty() ? "" : "   ") + names + "\n";
  return out;
}

}  // namespace vitreo
