// SPDX-License-Identifier: Apache-2.0
#include "vision/draw.h"

#include <Eigen/Eigenvalues>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>

namespace vitreo::vision {
namespace {

const cv::Scalar kTracked(80, 220, 60), kExpected(255, 190, 60), kTrail(60, 170, 255),
    kTarget(60, 60, 255);  // BGR
const cv::Scalar kInk(255, 255, 255), kShade(20, 20, 20);
constexpr int kFraction = 4;  // bits of a pixel that OpenCV's drawing takes
constexpr int kSegments = 180;

class Pen {
 public:
  explicit Pen(cv::Mat& canvas) : canvas_(canvas) {
    // One weight to the eye, however large the picture is shown: 1 px in 640.
    weight_ =
        std::max(1, static_cast<int>(std::lround(std::max(canvas.cols, canvas.rows) / 640.0)));
  }
  int weight() const { return weight_; }

  void line(const Eigen::Vector2d& a, const Eigen::Vector2d& b, const cv::Scalar& color,
            int times = 1) {
    if (!a.allFinite() || !b.allFinite() || std::max(a.norm(), b.norm()) > 1e5) return;
    cv::line(canvas_, fixed(a), fixed(b), color, times * weight_, cv::LINE_AA, kFraction);
  }

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

void draw_tracked(Pen& pen, const Ellipse& e) {
  const Eigen::Vector2d along(std::cos(e.angle), std::sin(e.angle)), u(5.0 * pen.weight(), 0),
      v(0, 5.0 * pen.weight());
  pen.line(e.center_px - e.semi_major_px * along, e.center_px + e.semi_major_px * along,
           kTracked * 0.6);
  pen.ellipse(e, kTracked, false);
  pen.line(e.center_px - u, e.center_px + u, kTracked);
  pen.line(e.center_px - v, e.center_px + v, kTracked);
}

constexpr double kMagnified = 10, kDeviations95 = 2.4477;  // the root of chi^2 of two at 95 %

void draw_covariance(Pen& pen, const Ellipse& e, const Eigen::Matrix2d& covariance) {
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> solver;
  solver.computeDirect(covariance);
  const Eigen::Vector2d axes =
      kMagnified * kDeviations95 * solver.eigenvalues().cwiseMax(0).cwiseSqrt();
  const Eigen::Vector2d along = solver.eigenvectors().col(1);
  pen.ellipse({e.center_px, axes.y(), axes.x(), std::atan2(along.y(), along.x())}, kTrail, false);
}

void draw_scale_bar(Pen& pen, const cv::Size& size, const Overlay& overlay) {
  const double edge = 12.0 * pen.weight(), y = size.height - edge - 1, tick = 4.0 * pen.weight();
  const Eigen::Vector2d left(edge, y), right(edge + overlay.scale_bar_px, y), up(0, tick);
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

cv::Mat draw_overlay(const cv::Mat& image, const Overlay& overlay) {
  if (image.empty() || (image.type() != CV_8UC1 && image.type() != CV_8UC3))
    throw std::invalid_argument("image: must be an 8-bit gray or BGR image");
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

cv::Mat crop_around(const cv::Mat& image, const Eigen::Vector2d& center_px, cv::Size size) {
  if (image.empty()) throw std::invalid_argument("image: is empty");
  if (size.width < 1 || size.height < 1)
    throw std::invalid_argument("size: must be at least one pixel");
  if (!center_px.allFinite()) throw std::invalid_argument("center_px: not finite");
  const int width = std::min(size.width, image.cols), height = std::min(size.height, image.rows);
  const auto first = [](double center, int length, int whole) {
    return static_cast<int>(std::clamp(std::round(center - (length - 1) / 2.0), 0.0,
                                       static_cast<double>(whole - length)));
  };
  const cv::Rect where(first(center_px.x(), width, image.cols),
                       first(center_px.y(), height, image.rows), width, height);
  return image(where).clone();
}

}  // namespace vitreo::vision
