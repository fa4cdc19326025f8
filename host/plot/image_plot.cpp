// SPDX-License-Identifier: Apache-2.0
#include "host/plot/image_plot.h"

#include "host/plot/plot_layout.h"
#include "host/plot/plot_style.h"
#include "host/text/markup.h"

#include <fmt/format.h>
#include <opencv2/imgcodecs.hpp>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>

namespace vitreo {
namespace {

// CSS px, of the picture
constexpr double kWidest = 640;
constexpr double kTallest = 560;
// A small image is enlarged to at most eight px a pixel: more shows nothing more.
constexpr double kLargestPixel = 8;
// CSS px
constexpr double kLeft = 58;
constexpr double kRight = 16;
constexpr double kTop = 34;
constexpr double kLegendRoom = 220;
// CSS px
constexpr double kText = 11.5;
constexpr double kBelow = 44;
constexpr double kNote = 18;
constexpr int kQuality = 90;

/// Geometry of the picture in the SVG. Pixel centers are integers, so that pixel u covers
/// [u - 0.5, u + 0.5] and its center is drawn at (u + 0.5) * scale.
struct Frame {
  double scale;
  double width;
  double height;
  double whole_width;
  double whole_height;
  double x(double u) const { return (u + 0.5) * scale; }  // within the picture
};

bool labeled(const ImagePlot& plot) {
  return std::any_of(plot.marks.begin(), plot.marks.end(),
                     [](const Series& one) { return !one.label.empty(); });
}

// The scale that lets the image fill its room without being distorted.
Frame frame_of(const ImagePlot& plot) {
  const double scale =
      std::min({kWidest / plot.image.cols, kTallest / plot.image.rows, kLargestPixel});
  Frame frame{scale, plot.image.cols * scale, plot.image.rows * scale, 0, 0};
  frame.whole_width = kLeft + frame.width + (labeled(plot) ? kLegendRoom : kRight);
  frame.whole_width = std::max(frame.whole_width, 320.0);  // or no title finds room
  frame.whole_height = kTop + frame.height + kBelow + (plot.note.empty() ? 0 : kNote);
  return frame;
}

std::string text(double x, double y, const char* anchor, const char* color, double size,
                 const std::string& words, const char* more = "") {
  return fmt::format(
      "<text x=\"{:.1f}\" y=\"{:.1f}\" font-size=\"{}\" text-anchor=\"{}\" fill=\"{}\"{}>{}</text>",
      x, y, size, anchor, color, more, escape_markup(words));
}

std::string line(double x1, double y1, double x2, double y2) {
  return fmt::format(
      "<line x1=\"{:.1f}\" y1=\"{:.1f}\" x2=\"{:.1f}\" y2=\"{:.1f}\" stroke=\"{}\"/>", x1, y1, x2,
      y2, kSpine);
}

std::string axes(const ImagePlot& plot, const Frame& frame) {
  const double bottom = kTop + frame.height;
  std::string svg = fmt::format(
      "<rect x=\"{}\" y=\"{}\" width=\"{:.1f}\" height=\"{:.1f}\" fill=\"none\" stroke=\"{}\"/>",
      kLeft, kTop, frame.width, frame.height, kSpine);
  // Never between pixels: the step is at least one.
  const auto ticks = [](int count, double length) {
    const Range range{0, std::max(count - 1.0, 1.0)};
    return make_ticks(range, std::max(1.0, nice_step(range.span(), length / 60)));
  };
  const Ticks across = ticks(plot.image.cols, frame.width);
  const Ticks down = ticks(plot.image.rows, frame.height);
  for (std::size_t i = 0; i < across.at.size(); ++i) {
    const double x = kLeft + frame.x(across.at[i]);
    svg += line(x, bottom, x, bottom + 4) +
           text(x, bottom + 17, "middle", kSoftInk, 11, across.labels[i]);
  }
  for (std::size_t i = 0; i < down.at.size(); ++i) {
    const double y = kTop + frame.x(down.at[i]);
    svg +=
        line(kLeft - 4, y, kLeft, y) + text(kLeft - 7, y + 4, "end", kSoftInk, 11, down.labels[i]);
  }
  svg += text(kLeft + frame.width / 2, bottom + 36, "middle", kInk, 12,
              axis_title("u", "px", across.exponent));
  return svg + fmt::format("<g transform=\"translate(17 {:.1f}) rotate(-90)\">{}</g>",
                           kTop + frame.height / 2,
                           text(0, 0, "middle", kInk, 12, axis_title("v", "px", down.exponent)));
}

/// Lines lie on a light rim, for a picture may be dark or bright there; all rims below all lines,
/// or one would hide another's line.
std::string marks(const ImagePlot& plot, const Frame& frame, const std::vector<Pen>& pens) {
  std::string rims;
  std::string lines;
  std::string points;
  for (std::size_t i = 0; i < plot.marks.size(); ++i) {
    std::vector<Stroke> strokes = strokes_of(plot.marks[i], 1, 1);
    for (Stroke& stroke : strokes)
      for (PlotPoint& point : stroke) point = {frame.x(point.x), frame.x(point.y)};
    if (pens[i].mark == Mark::points) {
      points += "<g stroke=\"#FFF\" stroke-width=\"1.2\">" + series_svg(strokes, pens[i]) + "</g>";
      continue;
    }
    Pen rim{"#FFFFFF", "", pens[i].width + 2.2, Mark::line};
    rims += series_svg(strokes, rim);
    lines += series_svg(strokes, pens[i]);
  }
  return "<g opacity=\"0.55\">" + rims + "</g>" + lines + points;
}

// White with a dark rim: it lies on the image, which may be dark or bright there.
std::string scale_bar(const ImagePlot& plot, const Frame& frame) {
  if (!(plot.scale_bar_px > 0)) return "";
  const double length = plot.scale_bar_px * frame.scale;
  const double x = 14;
  const double y = frame.height - 14;
  return fmt::format(
             "<rect x=\"{:.1f}\" y=\"{:.1f}\" width=\"{:.1f}\" height=\"4\" fill=\"#FFF\" "
             "stroke=\"#000\" "
             "stroke-width=\"0.8\"/>",
             x, y - 4, length) +
         text(x, y - 9, "start", "#FFFFFF", 12, plot.scale_bar_label,
              " stroke=\"#000000\" stroke-width=\"2.4\" paint-order=\"stroke\" "
              "stroke-linejoin=\"round\"");
}

std::string legend(const ImagePlot& plot, const Frame& frame, const std::vector<Pen>& pens) {
  std::string svg;
  const double x = kLeft + frame.width + 18;
  double y = kTop + 10;
  for (std::size_t i = 0; i < plot.marks.size(); ++i) {
    if (plot.marks[i].label.empty()) continue;
    svg += swatch_svg(x, y - 4, kSwatch, pens[i]);
    svg += text(x + kSwatch + 6, y, "start", kInk, kText,
                fitted(plot.marks[i].label, kText, kLegendRoom - kSwatch - 18 - 12));
    y += kLegendLine;
  }
  return svg;
}

// Pixels that are drawn larger than two px stay squares: smoothing would show an edge that was not
// measured.
std::string picture(const cv::Mat& image, const Frame& frame) {
  std::vector<unsigned char> jpeg;
  if (!cv::imencode(".jpg", image, jpeg, {cv::IMWRITE_JPEG_QUALITY, kQuality}))
    throw std::runtime_error("the image of a plot cannot be made a JPEG");
  const char* const rendering = frame.scale > 2 ? " style=\"image-rendering: pixelated\"" : "";
  return fmt::format(
      "<image width=\"{:.1f}\" height=\"{:.1f}\"{} href=\"data:image/jpeg;base64,{}\"/>",
      frame.width, frame.height, rendering, base64(jpeg));
}

}  // namespace

// p(t) = c + R(angle) (a cos t, b sin t), closed.
Series outline(const std::string& label, const vision::Ellipse& ellipse, Mark how) {
  // The sagitta of a chord of 1/96 turn is r (1 - cos(pi / 96)), 0.05 % of the radius: below a
  // pixel up to 1800 px.
  constexpr int kCorners = 96;
  Series made{label, {}, {}, how};
  const double c = std::cos(ellipse.angle);
  const double s = std::sin(ellipse.angle);
  for (int i = 0; i <= kCorners; ++i) {
    const double at = 2 * std::numbers::pi * i / kCorners;
    const double a = ellipse.semi_major_px * std::cos(at);
    const double b = ellipse.semi_minor_px * std::sin(at);
    made.x.push_back(ellipse.center_px.x() + a * c - b * s);
    made.y.push_back(ellipse.center_px.y() + a * s + b * c);
  }
  return made;
}

std::string to_svg(const ImagePlot& plot) {
  if (plot.image.empty() || (plot.image.type() != CV_8UC1 && plot.image.type() != CV_8UC3))
    throw std::invalid_argument("image: wants an 8-bit gray or color image");
  const Frame frame = frame_of(plot);
  const std::vector<Pen> pens = pens_for(plot.marks);
  std::string svg = fmt::format(
      "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {0:.0f} {1:.0f}\" width=\"{0:.0f}\" "
      "height=\"{1:.0f}\" "
      "role=\"img\" font-family=\"Helvetica Neue, Helvetica, Arial, Liberation Sans, sans-serif\">"
      "<title>{2}</title><rect width=\"{0:.0f}\" height=\"{1:.0f}\" fill=\"#FFFFFF\"/>",
      frame.whole_width, frame.whole_height, escape_markup(plot.title));
  svg += text(kLeft, 21, "start", kInk, 13.5,
              fitted(plot.title, 13.5, frame.whole_width - kLeft - 12), " font-weight=\"600\"");
  // An inner svg cuts what sticks out, and needs no name for it.
  svg +=
      fmt::format("<svg x=\"{}\" y=\"{}\" width=\"{:.1f}\" height=\"{:.1f}\" overflow=\"hidden\">",
                  kLeft, kTop, frame.width, frame.height);
  svg += picture(plot.image, frame) + marks(plot, frame, pens) + scale_bar(plot, frame) + "</svg>";
  svg += axes(plot, frame) + legend(plot, frame, pens);
  if (!plot.note.empty())
    svg += text(kLeft, kTop + frame.height + 56, "start", kSoftInk, 10.5,
                fitted(plot.note, 10.5, frame.whole_width - kLeft - 8));
  return svg + "</svg>";
}

}  // namespace vitreo
