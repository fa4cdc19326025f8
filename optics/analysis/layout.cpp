// SPDX-License-Identifier: Apache-2.0
#include "optics/analysis/layout.h"

#include "optics/analysis/layout_heights.h"
#include "optics/numerics/preconditions.h"
#include "optics/system/frames.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <numbers>
#include <stdexcept>
#include <utility>

namespace vitreo::optics {
namespace {

constexpr double kPad = 0.04;  // of the drawing's width, left and right
constexpr double kHeaderPx = 54;
constexpr double kFooterPx = 92;
constexpr int kProfileSteps = 48;
/// Dark enough on white, and distinguishable in print.
constexpr std::array<const char*, 7> kRayColors{"#b5332e", "#1f6f8b", "#4d7c33", "#9a6a12",
                                                "#6a4c93", "#3a3a8c", "#8c3a6b"};

/// std::to_chars: the same text in every locale.
std::string number(double value, int decimals = 2) {
  std::array<char, 64> text{};
  const auto end = std::to_chars(text.data(), text.data() + text.size(), value,
                                 std::chars_format::fixed, decimals)
                       .ptr;
  return {text.data(), end};
}

/// XML's reserved characters; control characters, most of which it forbids, become blanks.
std::string escaped(const std::string& text) {
  std::string safe;
  for (char c : text) {
    switch (c) {
      case '&':
        safe += "&amp;";
        break;
      case '<':
        safe += "&lt;";
        break;
      case '>':
        safe += "&gt;";
        break;
      case '"':
        safe += "&quot;";
        break;
      default:
        safe += static_cast<unsigned char>(c) < 0x20 ? ' ' : c;
    }
  }
  return safe;
}

/// Fill color by refractive index: paler for thinner media, none for air. The scale spans the eye's
/// media and lens plastics, 1.30 to 1.54.
std::string tint(double index) {
  if (index < 1.01) return "none";
  const double t = std::clamp((index - 1.30) / 0.24, 0.0, 1.0);
  const auto channel = [&](int pale, int deep) {
    return std::to_string(static_cast<int>(pale + t * (deep - pale)));
  };
  return "rgb(" + channel(238, 122) + "," + channel(246, 172) + "," + channel(251, 214) + ")";
}

/// Builds the SVG text piece by piece in `out_`. Positions are in m of the eye frame, z to the
/// right and height up; x(), y() and at() make pixels of them, in which y runs down.
class Drawing {
 public:
  Drawing(const System& system, std::span<const LayoutRay> rays, const LayoutOptions& options)
      : system_(system),
        rays_(rays),
        options_(options),
        heights_(detail::layout_heights(system, rays)) {
    measure();
  }
  std::string svg();

 private:
  void measure();
  double x(double z) const { return options_.width_px * kPad + (z - left_) * scale_; }
  double y(double height) const { return kHeaderPx + (half_height_ - height) * scale_; }
  std::string at(double z, double height) const { return number(x(z)) + "," + number(y(height)); }
  std::vector<Eigen::Vector2d> profile(int i) const;  // upper rim to lower rim
  std::string points(const std::vector<Eigen::Vector2d>& path) const;
  void text(double px, double py, const std::string& what, const char* style);
  void draw_media();
  void draw_axis();
  void draw_rays();
  void draw_surfaces();
  void draw_stop();
  void draw_marks();
  void draw_scale_bar();
  void draw_legend();
  void draw_labels();

  const System& system_;
  std::span<const LayoutRay> rays_;
  const LayoutOptions& options_;
  std::vector<double> heights_;
  double left_ = 0;
  double right_ = 0;
  double half_height_ = 0;
  double scale_ = 1;
  double bottom_px_ = 0;
  std::string out_;
};

/// One scale for both axes: the drawing's width holds the system's length.
/// Lengths are bounded by the system's length, so that the picture is at most about twice as high
/// as wide.
void Drawing::measure() {
  const auto take = [&](double z, double height) {
    left_ = std::min(left_, z);
    right_ = std::max(right_, z);
    half_height_ = std::max(half_height_, std::abs(height));
  };
  for (int i = 0; i < system_.size(); ++i) {
    for (const Eigen::Vector2d& p : profile(i)) take(p.x(), p.y());
  }
  for (const LayoutRay& ray : rays_) {
    for (const Eigen::Vector2d& p : ray.path) take(p.x(), p.y());
  }
  for (const LayoutMark& mark : options_.marks) take(mark.z, mark.half_height);
  const double across = std::max(right_ - left_, 1e-6);
  half_height_ = std::min(half_height_ * 1.06, across);  // a lost ray must not blow the picture up
  scale_ = options_.width_px * (1 - 2 * kPad) / across;
  bottom_px_ = kHeaderPx + 2 * half_height_ * scale_;
}

/// The section of a surface along its own x, which is the drawing's plane x-z unless it is tilted
/// about x or z: (z, x).
std::vector<Eigen::Vector2d> Drawing::profile(int i) const {
  std::vector<Eigen::Vector2d> path;
  const SurfaceFrame frame = surface_frame(system_, i + 1);
  for (int step = 0; step <= kProfileSteps; ++step) {
    // Dense at the rims, where a steep surface turns away.
    const double r =
        heights_[i] * std::sin((1 - 2.0 * step / kProfileSteps) * std::numbers::pi / 2);
    const double sag = system_.surfaces[i].sag(std::abs(r));
    const Eigen::Vector3d at = frame.to_eye({r, 0, sag});
    if (std::isfinite(sag)) path.emplace_back(at.z(), at.x());
  }
  return path;
}

/// The value of an SVG `points` attribute: "x,y x,y ...".
std::string Drawing::points(const std::vector<Eigen::Vector2d>& path) const {
  std::string list;
  for (const Eigen::Vector2d& p : path) list += (list.empty() ? "" : " ") + at(p.x(), p.y());
  return list;
}

/// `what` may come from a file or a script, so it is escaped; `style` is our own markup and is not.
void Drawing::text(double px, double py, const std::string& what, const char* style) {
  out_ += "<text x=\"" + number(px) + "\" y=\"" + number(py) + "\" " + style + ">" + escaped(what) +
          "</text>\n";
}

/// A medium is the polygon between the profiles of its two surfaces.
void Drawing::draw_media() {
  for (int i = 0; i + 1 < system_.size(); ++i) {
    const std::string fill = tint(system_.surfaces[i].index);
    if (fill == "none") continue;
    std::vector<Eigen::Vector2d> outline = profile(i);
    std::vector<Eigen::Vector2d> behind = profile(i + 1);
    outline.insert(outline.end(), behind.rbegin(), behind.rend());
    out_ += "<polygon points=\"" + points(outline) + "\" fill=\"" + fill + "\" stroke=\"" + fill +
            "\" stroke-width=\"0.6\"/>\n";
  }
}

/// Dash-dotted, as axes are in technical drawings.
void Drawing::draw_axis() {
  const double overhang = options_.width_px * kPad * 0.6;
  out_ += "<line x1=\"" + number(x(left_) - overhang) + "\" y1=\"" + number(y(0)) + "\" x2=\"" +
          number(x(right_) + overhang) + "\" y2=\"" + number(y(0)) +
          "\" stroke=\"#666\" stroke-width=\"0.8\" stroke-dasharray=\"14 3 2 3\"/>\n";
}

/// Clipped to the frame, since a lost ray may lead far out.
void Drawing::draw_rays() {
  for (const LayoutRay& ray : rays_) {
    const char* const color =
        kRayColors[static_cast<std::size_t>(std::abs(ray.group)) % kRayColors.size()];
    out_ += "<polyline points=\"" + points(ray.path) + "\" fill=\"none\" stroke=\"" + color +
            "\" stroke-width=\"0.9\" stroke-linejoin=\"round\" clip-path=\"url(#frame)\"/>\n";
  }
}

/// Surfaces over the media, then the lines that close solid media at their rims: full weight for a
/// lens, whose two sides end at one height, thin where a medium ends because its surfaces nearly
/// meet.
void Drawing::draw_surfaces() {
  for (int i = 0; i < system_.size(); ++i) {
    out_ += "<polyline points=\"" + points(profile(i)) + "\" fill=\"none\" stroke=\"" +
            (i == 0 ? "#7a3b2e" : "#1d3557") + "\" stroke-width=\"" + (i == 0 ? "2.4" : "1.4") +
            "\" stroke-linecap=\"round\"/>\n";
  }
  // The rims of what is solid.
  for (int i = 1; i + 1 < system_.size(); ++i) {
    if (system_.surfaces[i].index < 1.01) continue;
    const auto front = profile(i);
    const auto behind = profile(i + 1);
    const bool lens = heights_[i] == heights_[i + 1];
    for (const auto& [a, b] :
         {std::pair(front.front(), behind.front()), std::pair(front.back(), behind.back())}) {
      out_ += "<line x1=\"" + number(x(a.x())) + "\" y1=\"" + number(y(a.y())) + "\" x2=\"" +
              number(x(b.x())) + "\" y2=\"" + number(y(b.y())) +
              "\" stroke=\"#1d3557\" stroke-width=\"" + (lens ? "1.4" : "0.7") + "\"/>\n";
    }
  }
}

/// Two bars from the stop's radius outwards, with a tick at its edge.
void Drawing::draw_stop() {
  if (!system_.stop) return;
  const double z = system_.vertex(system_.stop->surface);
  const double r = system_.stop->radius;
  const double rim = std::max(heights_[system_.stop->surface - 1], 1.6 * r);
  for (double side : {1.0, -1.0}) {
    out_ += "<line x1=\"" + number(x(z)) + "\" y1=\"" + number(y(side * r)) + "\" x2=\"" +
            number(x(z)) + "\" y2=\"" + number(y(side * rim)) +
            "\" stroke=\"#111\" stroke-width=\"3.2\"/>\n";
    out_ += "<line x1=\"" + number(x(z) - 5) + "\" y1=\"" + number(y(side * r)) + "\" x2=\"" +
            number(x(z) + 5) + "\" y2=\"" + number(y(side * r)) +
            "\" stroke=\"#111\" stroke-width=\"1.6\"/>\n";
  }
}

/// Marks are dashed lines across the axis with a label over them, such as the place of the aerial
/// image.
void Drawing::draw_marks() {
  for (const LayoutMark& mark : options_.marks) {
    out_ += "<line x1=\"" + number(x(mark.z)) + "\" y1=\"" + number(y(mark.half_height)) +
            "\" x2=\"" + number(x(mark.z)) + "\" y2=\"" + number(y(-mark.half_height)) +
            "\" stroke=\"#333\" stroke-width=\"1.1\" stroke-dasharray=\"5 3\"/>\n";
    const bool right_half = mark.z > (left_ + right_) / 2;  // keep the label inside the picture
    text(x(mark.z) + (right_half ? 4 : -4), y(mark.half_height) - 6, mark.label,
         right_half ? "text-anchor=\"end\" font-size=\"12\""
                    : "text-anchor=\"start\" font-size=\"12\"");
  }
}

/// In the footer, so that no ray crosses it; its length is a round number of millimeters.
void Drawing::draw_scale_bar() {
  constexpr double kMm = 1e-3;
  // The longest round length of at most a fifth of the system.
  double length = kMm;
  for (double step : {1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0}) {
    if (step * kMm <= 0.2 * (right_ - left_)) length = step * kMm;
  }
  const double px = x(left_);
  const double py = bottom_px_ + 34;
  const double end = px + length * scale_;
  out_ += "<path d=\"M" + number(px) + " " + number(py - 4) + "v8 M" + number(px) + " " +
          number(py) + "H" + number(end) + " M" + number(end) + " " + number(py - 4) +
          "v8\" fill=\"none\" stroke=\"#111\" stroke-width=\"1.4\"/>\n";
  text((px + end) / 2, py - 8, number(length / kMm, 0) + " mm",
       "text-anchor=\"middle\" font-size=\"12\"");
}

/// One entry for each medium that is not air, wrapped by an estimate of the text's width.
void Drawing::draw_legend() {
  double px = x(left_);
  double py = bottom_px_ + 66;
  for (int i = 0; i < system_.size(); ++i) {
    const double index = system_.surfaces[i].index;
    if (index < 1.01) continue;
    const bool named = static_cast<std::size_t>(i) < options_.media.size();
    const std::string label = (named ? options_.media[i] : "behind " + std::to_string(i + 1)) +
                              "  n = " + number(index, 3);
    const double width = 30 + 6.6 * static_cast<double>(label.size());
    if (px + width > options_.width_px && px > x(left_)) px = x(left_), py += 20;
    out_ += "<rect x=\"" + number(px) + "\" y=\"" + number(py - 11) +
            "\" width=\"16\" height=\"13\" stroke=\"#1d3557\" stroke-width=\"0.6\" fill=\"" +
            tint(index) + "\"/>\n";
    text(px + 22, py, label, "font-size=\"12\"");
    px += width + 8;
  }
}

/// Numbers of the surfaces, as the thesis counts them, above their upper rims, on up to three
/// levels where rims stand closer than a number is wide.
void Drawing::draw_labels() {
  constexpr double kNear = 13;
  double before = -1e9;
  int row = 0;
  for (int i = 0; i < system_.size(); ++i) {
    const Eigen::Vector2d rim = profile(i).front();
    const double px = x(rim.x());
    const double py = y(rim.y());
    row = px - before < kNear && px > before - kNear ? (row + 1) % 3 : 0;
    before = px;
    const double top = py - 9 - 14 * row;
    if (row > 0) {
      out_ += "<line x1=\"" + number(px) + "\" y1=\"" + number(py - 3) + "\" x2=\"" + number(px) +
              "\" y2=\"" + number(top + 2) + "\" stroke=\"#999\" stroke-width=\"0.6\"/>\n";
    }
    text(px, top, std::to_string(i + 1),
         "text-anchor=\"middle\" font-size=\"12\" fill=\"#1d3557\"");
  }
}

/// Later elements cover earlier ones: media first, labels last.
std::string Drawing::svg() {
  const double height = bottom_px_ + kFooterPx + 20;
  const std::string size = number(options_.width_px, 0) + "\" height=\"" + number(height, 0);
  out_ = "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"" + size + "\" viewBox=\"0 0 " +
         number(options_.width_px, 0) + " " + number(height, 0) +
         "\" font-family=\"Helvetica, Arial, sans-serif\" fill=\"#111\">\n";
  out_ += "<defs><clipPath id=\"frame\"><rect x=\"0\" y=\"" + number(kHeaderPx - 6) +
          "\" width=\"" + number(options_.width_px) + "\" height=\"" +
          number(2 * half_height_ * scale_ + 12) + "\"/></clipPath></defs>\n";
  out_ += "<rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n";
  text(options_.width_px * kPad, 26, options_.title.empty() ? system_.name : options_.title,
       "font-size=\"16\" font-weight=\"bold\"");
  draw_media();
  draw_axis();
  draw_rays();
  draw_surfaces();
  draw_stop();
  draw_marks();
  draw_labels();
  draw_scale_bar();
  draw_legend();
  return out_ + "</svg>\n";
}

}  // namespace

void LayoutOptions::check() const {
  detail::require(width_px >= 100 && width_px <= 20000, "width_px: must lie within 100 and 20000");
  for (const LayoutMark& mark : marks) {
    if (!std::isfinite(mark.z) || !(mark.half_height >= 0 && std::isfinite(mark.half_height))) {
      throw std::invalid_argument("marks: must be finite");
    }
  }
}

/// Checked before anything is drawn: a NaN would be printed as text that no reader of SVG takes.
std::string layout_svg(const System& system, std::span<const LayoutRay> rays,
                       const LayoutOptions& options) {
  system.check();
  options.check();
  for (const LayoutRay& ray : rays) {
    for (const Eigen::Vector2d& point : ray.path) {
      detail::require(point.allFinite(), "rays: must be finite");
    }
  }
  return Drawing(system, rays, options).svg();
}

}  // namespace vitreo::optics
