// SPDX-License-Identifier: Apache-2.0
#include "vision/draw.h"

#include "vision/preconditions.h"

#include <Eigen/Eigenvalues>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace vitreo::vision {
namespace {

// Colors, BGR.
const cv::Scalar kTracked(80, 220, 60);
const cv::Scalar kExpected(255, 190, 60);
const cv::Scalar kTrail(60, 170, 255);
const cv::Scalar kTarget(60, 60, 255);
const cv::Scalar kInk(255, 255, 255);
const cv::Scalar kShade(20, 20, 20);
constexpr int kFraction = 4;    // fractional bits of OpenCV's drawing coordinates
constexpr int kSegments = 180;  // of an ellipse: 2 degrees each

// Draws in image coordinates, the center of the first pixel at (0, 0), to a sixteenth of a pixel.
class Pen {
 public:
  explicit Pen(cv::Mat& canvas) : canvas_(canvas) {
    // The same weight on a page or screen whatever the image's size: 1 px in 640.
    weight_ =
        std::max(1, static_cast<int>(std::lround(std::max(canvas.cols, canvas.rows) / 640.0)));
  }
  int weight() const { return weight_; }

  void line(const Eigen::Vector2d& a, const Eigen::Vector2d& b, const cv::Scalar& color,
            int times = 1) {
    // Far outside, OpenCV's fixed-point coordinates would overflow.
    if (!a.allFinite() || !b.allFinite() || std::max(a.norm(), b.norm()) > 1e5) return;
    cv::line(canvas_, fixed(a), fixed(b), color, times * weight_, cv::LINE_AA, kFraction);
  }

  // By chords: cv::ellipse rounds the angle to whole degrees and draws no dashes.
  // Dashed: three of six chords, so that a prediction looks unlike a measurement.
  void ellipse(const Ellipse& e, const cv::Scalar& color, bool dashed) {
    for (int k = 0; k < kSegments; ++k) {
      if (dashed && k % 6 >= 3) continue;
      line(e.point(angle(k)), e.point(angle(k + 1)), color);
    }
  }

  // Dark under light, so that it reads on any ground.
  void text(const std::string& words, const cv::Point& at) {
    cv::putText(canvas_, words, at, cv::FONT_HERSHEY_SIMPLEX, 0.5 * weight_, kShade, 4 * weight_,
                cv::LINE_AA);
    cv::putText(canvas_, words, at, cv::FONT_HERSHEY_SIMPLEX, 0.5 * weight_, kInk, weight_,
                cv::LINE_AA);
  }

  cv::Size size_of(const std::string& words) const {
    int below = 0;
    return cv::getTextSize(words, cv::FONT_HERSHEY_SIMPLEX, 0.5 * weight_, weight_, &below);
  }

 private:
  static double angle(int k) { return 2 * std::numbers::pi * k / kSegments; }
  static cv::Point fixed(const Eigen::Vector2d& p) {
    return {static_cast<int>(std::lround(p.x() * (1 << kFraction))),
            static_cast<int>(std::lround(p.y() * (1 << kFraction)))};
  }
  cv::Mat& canvas_;
  int weight_;
};

// The ellipse, its major axis (darker) and a cross of 5 px at its center.
// Colors and line weights are relative, so that the same picture reads on a page and on a screen.
void draw_tracked(Pen& pen, const Ellipse& e) {
  const Eigen::Vector2d along(std::cos(e.angle), std::sin(e.angle));
  const Eigen::Vector2d u(5.0 * pen.weight(), 0);
  const Eigen::Vector2d v(0, 5.0 * pen.weight());
  pen.line(e.center_px - e.semi_major_px * along, e.center_px + e.semi_major_px * along,
           kTracked * 0.6);
  pen.ellipse(e, kTracked, false);
  pen.line(e.center_px - u, e.center_px + u, kTracked);
  pen.line(e.center_px - v, e.center_px + v, kTracked);
}

constexpr double kMagnified = 10;
// Square root of the 95 % quantile of chi^2 with two degrees of freedom, 5.991.
constexpr double kDeviations95 = 2.4477;

// The 95 % confidence ellipse of a center: its semi-axes are the roots of the covariance's
// eigenvalues, ascending as Eigen sorts them, times kDeviations95.
// Drawn ten times as large, since a center that is known to a tenth of a pixel would have a dot for
// an ellipse.
void draw_covariance(Pen& pen, const Ellipse& e, const Eigen::Matrix2d& covariance) {
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> solver;
  solver.computeDirect(covariance);
  const Eigen::Vector2d axes =
      kMagnified * kDeviations95 * solver.eigenvalues().cwiseMax(0).cwiseSqrt();
  const Eigen::Vector2d along = solver.eigenvectors().col(1);
  pen.ellipse({e.center_px, axes.y(), axes.x(), std::atan2(along.y(), along.x())}, kTrail, false);
}

// A bar with ticks at the bottom left and its label above, light on dark so that it reads on any
// ground.
// The caller gives length and label; the drawing knows no scale of its own.
void draw_scale_bar(Pen& pen, const cv::Size& size, const Overlay& overlay) {
  const double edge = 12.0 * pen.weight();
  const double y = size.height - edge - 1;
  const double tick = 4.0 * pen.weight();
  const Eigen::Vector2d left(edge, y);
  const Eigen::Vector2d right(edge + overlay.scale_bar_px, y);
  const Eigen::Vector2d up(0, tick);
  for (const bool shade : {true, false}) {
    const cv::Scalar& color = shade ? kShade : kInk;
    const int times = shade ? 4 : 2;
    pen.line(left, right, color, times);
    pen.line(left - up, left + up, color, times);
    pen.line(right - up, right + up, color, times);
  }
  const cv::Size words = pen.size_of(overlay.scale_bar_label);
  const double middle = edge + overlay.scale_bar_px / 2 - words.width / 2.0;
  pen.text(overlay.scale_bar_label, {static_cast<int>(std::max(middle, edge)),
                                     static_cast<int>(y - tick - 5 * pen.weight())});
}

}  // namespace

// In the order of importance: what is drawn later covers what was drawn before.
// Draws on a copy: an image that is tracked or recorded is never touched.
cv::Mat draw_overlay(const cv::Mat& image, const Overlay& overlay) {
  require(!image.empty() && (image.type() == CV_8UC1 || image.type() == CV_8UC3),
          "image: must be an 8-bit gray or BGR image");
  cv::Mat canvas;
  if (image.channels() == 1)
    cv::cvtColor(image, canvas, cv::COLOR_GRAY2BGR);
  else
    canvas = image.clone();
  Pen pen(canvas);
  for (std::size_t k = 1; k < overlay.trail_px.size(); ++k) {
    pen.line(overlay.trail_px[k - 1], overlay.trail_px[k], kTrail);
  }
  if (overlay.target_px) {
    const double radius = 6.0 * pen.weight();
    pen.ellipse({*overlay.target_px, radius, radius, 0}, kTarget, false);
  }
  if (overlay.expected) pen.ellipse(*overlay.expected, kExpected, true);
  for (const auto& contour : overlay.contours_px)
    for (std::size_t k = 0; k < contour.size(); ++k)
      pen.line(contour[k], contour[(k + 1) % contour.size()], kTracked);
  if (overlay.tracked) draw_tracked(pen, *overlay.tracked);
  if (overlay.tracked && overlay.covariance_px2)
    draw_covariance(pen, *overlay.tracked, *overlay.covariance_px2);
  if (!overlay.caption.empty()) pen.text(overlay.caption, {8 * pen.weight(), 18 * pen.weight()});
  if (overlay.scale_bar_px > 0) draw_scale_bar(pen, canvas.size(), overlay);
  return canvas;
}

// At most the image's size. A center near the border gets a crop that lies inside, so all crops of
// a series have one size.
cv::Mat crop_around(const cv::Mat& image, const Eigen::Vector2d& center_px, cv::Size size) {
  require(!image.empty(), "image: is empty");
  require(size.width >= 1 && size.height >= 1, "size: must be at least one pixel");
  require(center_px.allFinite(), "center_px: not finite");
  const int width = std::min(size.width, image.cols);
  const int height = std::min(size.height, image.rows);
  // First pixel of a crop of `length` centered there, kept inside: pixel centers are whole numbers.
  const auto first = [](double center, int length, int whole) {
    return static_cast<int>(std::clamp(std::round(center - (length - 1) / 2.0), 0.0,
                                       static_cast<double>(whole - length)));
  };
  const cv::Rect where(first(center_px.x(), width, image.cols),
                       first(center_px.y(), height, image.rows), width, height);
  return image(where).clone();
}

}  // namespace vitreo::vision
