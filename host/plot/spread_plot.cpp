// SPDX-License-Identifier: Apache-2.0
#include "host/plot/spread_plot.h"

#include "host/plot/plot_axes.h"
#include "host/plot/plot_layout.h"
#include "host/plot/svg_parts.h"
#include "host/text/units.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace vitreo {
namespace {

constexpr double kCap = 3.5;     // px, half the width of a bar's cap
constexpr double kBeside = 5.0;  // px by which series stand beside each other, so that bars do not
                                 // cover each other
constexpr const char* kRule = "#E7EAED";

/// SI of one of it: data come in SI, axes are in the unit of the plot. Throws
/// std::invalid_argument.
double factor_of(const std::string& symbol) {
  const auto unit = find_unit(symbol);
  if (!unit) throw std::invalid_argument("'" + symbol + "' is not a unit");
  return unit->factor;
}

/// One drawing: ranges and ticks first, then axes, bars, lines and marks on top.
class SpreadDrawer {
 public:
  SpreadDrawer(const SpreadPlot& plot, int width, int height)
      : plot_(plot),
        width_(width),
        height_(height),
        x_factor_(factor_of(plot.x.unit)),
        y_factor_(factor_of(plot.y.unit)) {
    for (const SpreadSeries& one : plot.series) {
      // Columns are read by index below.
      if (one.x.size() != one.middle.size() || one.x.size() != one.low.size() ||
          one.x.size() != one.high.size())
        throw std::invalid_argument("series \"" + one.label + "\" has columns of unequal length");
      // The legend is that of a plot of lines: only labels and pens are needed of it.
      labels_.push_back({one.label, {}, {}, Mark::line});
    }
    legend_.series = labels_;
    double legend_height = 0;
    // The legend takes what it needs above the box before the box is laid out.
    const bool legend = has_legend(legend_);
    if (legend) legend_places(legend_, width - 84.0, &legend_height);
    box_ = {66, 34 + (legend ? legend_height : 0), 0, 0};
    box_.width = width - box_.left - 16;
    // Ticks, the axis' title and, where there is one, a line for the note.
    box_.height = height - box_.top - (plot.note.empty() ? 48 : 66);
    find_ranges();
  }

  std::string svg() const {
    std::string svg = open_svg(width_, height_, plot_.title);
    svg += text_svg(box_.left, 21, fitted(plot_.title, 13.5, width_ - box_.left - 12),
                    {13.5, "start", kInk, " font-weight=\"600\""});
    // What is painted later lies above: rules, bars and lines, and the marks last.
    svg += axes();
    const std::vector<Pen> pens = pens_for(labels_);
    for (std::size_t i = 0; i < plot_.series.size(); ++i)
      svg += series(
          plot_.series[i], pens[i],
          // Symmetric about the place: an odd number of series has one that stands on it.
          kBeside * (static_cast<double>(i) - (static_cast<double>(plot_.series.size()) - 1) / 2));
    if (has_legend(legend_)) svg += legend(pens);
    if (!plot_.note.empty())
      svg +=
          text_svg(box_.left, box_.bottom() + 56, fitted(plot_.note, 10.5, width_ - box_.left - 8),
                   {10.5, "start", kSoftInk, ""});
    return svg + "</svg>";
  }

 private:
  /// Bars belong to the range of y; steps have half a step of air on both sides.
  void find_ranges() {
    Range x;
    Range y;
    for (const SpreadSeries& one : plot_.series)
      for (std::size_t i = 0; i < one.x.size(); ++i) {
        // What is not a number leaves a gap and no trace in the range.
        if (drawable(one.x[i])) x.include(one.x[i] / x_factor_);
        for (const double value : {one.middle[i], one.low[i], one.high[i]})
          if (drawable(value)) y.include(value / y_factor_);
      }
    // Named steps stand at 0, 1, 2 and so on, whatever their values.
    x_ = plot_.steps.empty() ? padded(widened(x), 0.08, false)
                             : Range{-0.5, static_cast<double>(plot_.steps.size()) - 0.5};
    y_ = padded(widened(y), 0.06, true);
    // A tick about every 45 px of height and 80 px of width can be read without touching.
    y_ticks_ = make_ticks(y_, nice_step(y_.span(), box_.height / 45));
    if (plot_.steps.empty()) x_ticks_ = make_ticks(x_, nice_step(x_.span(), box_.width / 80));
    for (std::size_t i = 0; i < plot_.steps.size(); ++i) {
      x_ticks_.at.push_back(static_cast<double>(i));
      x_ticks_.labels.push_back(plot_.steps[i]);
    }
  }
  double px(double value) const { return box_.left + (value - x_.low) / x_.span() * box_.width; }
  double py(double value) const {
    return box_.bottom() - (value - y_.low) / y_.span() * box_.height;
  }

  /// Horizontal rules alone: the values are read along them. Labels that would touch are left out.
  std::string axes() const {
    std::string svg;
    for (std::size_t i = 0; i < y_ticks_.at.size(); ++i) {
      // On whole pixels a line of 1 px is sharp.
      const double y = crisp(py(y_ticks_.at[i]));
      svg += line_svg(box_.left, y, box_.right(), y, kRule) +
             text_svg(box_.left - 7, y + 4, y_ticks_.labels[i], {11, "end", kSoftInk, ""});
    }
    const double bottom = crisp(box_.bottom());
    svg += line_svg(crisp(box_.left), box_.top, crisp(box_.left), bottom, kSpine) +
           line_svg(crisp(box_.left), bottom, box_.right(), bottom, kSpine);
    std::size_t longest = 1;
    for (const std::string& label : x_ticks_.labels) longest = std::max(longest, label.size());
    const double room =
        box_.width / static_cast<double>(std::max<std::size_t>(x_ticks_.at.size(), 1));
    // 6.4 px is the mean width of a letter of 11 px; SVG gives no measure of text.
    const double wanted = 6.4 * static_cast<double>(std::min<std::size_t>(longest, 14)) + 8;
    // Every second, third and so on: the labels that stay are evenly spaced.
    const auto every = static_cast<std::size_t>(std::ceil(wanted / room));
    for (std::size_t i = 0; i < x_ticks_.at.size(); i += every) {
      const double x = crisp(px(x_ticks_.at[i]));
      svg += line_svg(x, bottom, x, bottom + 4, kSpine) +
             text_svg(x, bottom + 17,
                      fitted(x_ticks_.labels[i], 11, room * static_cast<double>(every)),
                      {11, "middle", kSoftInk, ""});
    }
    svg += text_svg(
        box_.left + box_.width / 2, box_.bottom() + 36,
        fitted(axis_title(plot_.x.label, plot_.x.unit, x_ticks_.exponent), 12, width_ - 20),
        {12, "middle", kInk, ""});
    return svg +
           fmt::format("<g transform=\"translate(17 {:.1f}) rotate(-90)\">{}</g>",
                       box_.top + box_.height / 2,
                       text_svg(0, 0,
                                fitted(axis_title(plot_.y.label, plot_.y.unit, y_ticks_.exponent),
                                       12, height_ - 10),
                                {12, "middle", kInk, ""}));
  }

  /// Hollow marks, so that those of another series behind them are seen.
  std::string series(const SpreadSeries& one, const Pen& pen, double aside) const {
    std::vector<Stroke> strokes(1);
    std::string bars;
    std::string marks;
    for (std::size_t i = 0; i < one.x.size(); ++i) {
      // A gap breaks the line: nothing is drawn across what was not measured.
      if (!drawable(one.middle[i]) || !drawable(one.x[i])) {
        strokes.emplace_back();
        continue;
      }
      const double x = px(one.x[i] / x_factor_) + aside;
      const double y = py(one.middle[i] / y_factor_);
      strokes.back().push_back({x, y});
      marks += fmt::format(
          "<circle cx=\"{:.1f}\" cy=\"{:.1f}\" r=\"3.2\" fill=\"#FFFFFF\" "
          "stroke=\"{}\" stroke-width=\"1.6\"/>",
          x, y, pen.color);
      // One repeat has no spread: a cap alone would look like a very small one.
      if (!drawable(one.low[i]) || !drawable(one.high[i]) || one.low[i] == one.high[i]) continue;
      const double top = py(one.high[i] / y_factor_);
      const double bottom = py(one.low[i] / y_factor_);
      bars += fmt::format(
          "<path d=\"M{0:.1f} {2:.1f}H{1:.1f}M{0:.1f} {3:.1f}H{1:.1f}M{4:.1f} "
          "{2:.1f}V{3:.1f}\" stroke=\"{5}\" stroke-width=\"1.2\" fill=\"none\"/>",
          x - kCap, x + kCap, top, bottom, x, pen.color);
    }
    // Gaps side by side leave strokes without a point.
    std::erase_if(strokes, [](const Stroke& stroke) { return stroke.empty(); });
    // What comes last lies on top.
    return bars + series_svg(strokes, pen) + marks;
  }

  std::string legend(const std::vector<Pen>& pens) const {
    double height = 0;
    const std::vector<PlotPoint> places = legend_places(legend_, box_.width, &height);
    // The height is asked again: the places depend on the width that the box has got.
    const double top = box_.top - height + 4;
    std::string svg;
    for (std::size_t i = 0; i < labels_.size(); ++i) {
      if (labels_[i].label.empty()) continue;
      svg += swatch_svg(box_.left + places[i].x, top + places[i].y - 4, kSwatch, pens[i]) +
             text_svg(box_.left + places[i].x + kSwatch + 6, top + places[i].y,
                      fitted(labels_[i].label, kLegendText,
                             width_ - box_.left - places[i].x - kSwatch - 8),
                      {});
    }
    return svg;
  }

  const SpreadPlot& plot_;
  double width_;
  double height_;
  double x_factor_;
  double y_factor_;
  std::vector<Series> labels_;
  Plot legend_{};
  Box box_{};
  Range x_{};
  Range y_{};
  Ticks x_ticks_{};
  Ticks y_ticks_{};
};

}  // namespace

std::string to_svg(const SpreadPlot& plot, int width, int height) {
  return SpreadDrawer(plot, width, height).svg();
}

}  // namespace vitreo
