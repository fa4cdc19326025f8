// SPDX-License-Identifier: Apache-2.0
#include "vision/tip_template.h"

#include "vision/preconditions.h"

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace vitreo::vision {
namespace {

constexpr int kBeyond_px = 6;  // of ground behind the tip, and beside it
constexpr int kSearch_px =
    5;  // either way: an ellipse is off by a part of it, and turned by a few degrees
constexpr double kLeastCorrelation = 0.6;
constexpr double kLeastLead = 0.1;  // of the better heading's correlation

Eigen::Vector2d turned(const Eigen::Vector2d& p, double angle) {
  const double c = std::cos(angle);
  const double s = std::sin(angle);
  return {c * p.x() - s * p.y(), s * p.x() + c * p.y()};
}

bool within(const cv::Mat& image, const Eigen::Vector2d& at) {
  return at.allFinite() && at.x() >= 0 && at.y() >= 0 && at.x() <= image.cols - 1 &&
         at.y() <= image.rows - 1;
}

// Vertex of the parabola through three equally spaced values, of which the middle one is the
// largest.
double vertex(double before, double at, double after) {
  const double curvature = before - 2 * at + after;
  return curvature < 0 ? std::clamp((before - after) / (2 * curvature), -0.5, 0.5) : 0;
}

}  // namespace

// From the body's middle on, so that the end of the body itself counts, which bodies have at both
// ends, and all that lies between it and the tip.
TipTemplate::TipTemplate(const cv::Mat& image, const Ellipse& body, const Eigen::Vector2d& tip_px) {
  require(within(image, tip_px), "tip: is not in the image");
  const Eigen::Vector2d along = turned(tip_px - body.center_px, -body.angle);
  require(std::abs(along.x()) > body.semi_minor_px / 2 && along.norm() < 4 * body.semi_major_px,
          "tip: is no end of the body: it lies beside its middle, or far from it");
  const double heading = along.x() > 0 ? body.angle : body.angle + std::numbers::pi;
  tip_ = turned(tip_px - body.center_px, -heading);
  scale_px_ = std::sqrt(body.semi_major_px * body.semi_minor_px);
  from_ = std::min(body.semi_major_px / 2, tip_.x() - 2 * kBeyond_px);
  columns_ = static_cast<int>(std::ceil(tip_.x() + kBeyond_px - from_));
  rows_ = 2 * static_cast<int>(std::ceil(body.semi_minor_px / 2 + std::abs(tip_.y()))) + 1;
  template_ = sampled(image, body, heading, 0);
}

// Gray levels on the template's grid, `margin` px wider all round, of a body that may be larger.
cv::Mat TipTemplate::sampled(const cv::Mat& image, const Ellipse& body, double heading,
                             double margin) const {
  const double scale = std::sqrt(body.semi_major_px * body.semi_minor_px) / scale_px_;
  const Eigen::Vector2d x = scale * turned({1, 0}, heading);
  const Eigen::Vector2d y = scale * turned({0, 1}, heading);
  const int half = rows_ / 2;
  const Eigen::Vector2d first = body.center_px + (from_ - margin) * x - (half + margin) * y;
  const cv::Matx23d image_from_grid(x.x(), y.x(), first.x(), x.y(), y.y(), first.y());
  const int more = 2 * static_cast<int>(margin);
  cv::Mat grid;
  cv::warpAffine(image, grid, image_from_grid, cv::Size(columns_ + more, rows_ + more),
                 cv::INTER_LINEAR | cv::WARP_INVERSE_MAP, cv::BORDER_REPLICATE);
  cv::cvtColor(grid, grid, cv::COLOR_BGR2GRAY);
  return grid;
}

TipTemplate::Fit TipTemplate::best_of(const cv::Mat& image, const Ellipse& body,
                                      double heading) const {
  cv::Mat score;
  cv::matchTemplate(sampled(image, body, heading, kSearch_px), template_, score,
                    cv::TM_CCOEFF_NORMED);
  Fit fit;
  cv::Point at;
  cv::minMaxLoc(score, nullptr, &fit.correlation, nullptr, &at);
  const auto of = [&](int u, int v) { return static_cast<double>(score.at<float>(v, u)); };
  Eigen::Vector2d shift(at.x - kSearch_px, at.y - kSearch_px);
  if (at.x > 0 && at.x + 1 < score.cols)
    shift.x() += vertex(of(at.x - 1, at.y), of(at.x, at.y), of(at.x + 1, at.y));
  if (at.y > 0 && at.y + 1 < score.rows)
    shift.y() += vertex(of(at.x, at.y - 1), of(at.x, at.y), of(at.x, at.y + 1));
  fit.tip = tip_ + shift;
  return fit;
}

std::optional<Eigen::Vector2d> TipTemplate::find(const cv::Mat& image, const Ellipse& body) const {
  const Fit ahead = best_of(image, body, body.angle);
  const Fit behind = best_of(image, body, body.angle + std::numbers::pi);
  const bool turn = behind.correlation > ahead.correlation;
  const Fit& best = turn ? behind : ahead;
  if (best.correlation < kLeastCorrelation ||
      std::abs(ahead.correlation - behind.correlation) < kLeastLead)
    return std::nullopt;
  const double scale = std::sqrt(body.semi_major_px * body.semi_minor_px) / scale_px_;
  const Eigen::Vector2d tip =
      body.center_px + scale * turned(best.tip, body.angle + (turn ? std::numbers::pi : 0));
  if (!within(image, tip)) return std::nullopt;
  return tip;
}

}  // namespace vitreo::vision
