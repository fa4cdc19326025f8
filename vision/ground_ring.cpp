// SPDX-License-Identifier: Apache-2.0
#include "vision/ground_ring.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace vitreo::vision {
namespace {

constexpr double kBeyond_px = 9;  // the inner circle of samples, beyond the longer semi-axis
constexpr double kApart_px = 8;   // and the outer one beyond that
constexpr double kStructure = 5;  // gray levels, standard deviation

// Mean of all channels over 3 x 3 pixels, at the image's nearest pixel.
float gray_at(const cv::Mat& image, double u, double v) {
  const int i = std::clamp(static_cast<int>(std::lround(u)), 1, image.cols - 2);
  const int j = std::clamp(static_cast<int>(std::lround(v)), 1, image.rows - 2);
  int sum = 0;
  for (int y = j - 1; y <= j + 1; ++y) {
    const auto* p = image.ptr<cv::Vec3b>(y) + i - 1;
    for (int x = 0; x < 3; ++x) sum += p[x][0] + p[x][1] + p[x][2];
  }
  return static_cast<float>(sum) / 27;
}

}  // namespace

// Two circles, in the image's directions: an ellipse that turns leaves them where they are.
GroundRing::GroundRing(const cv::Mat& image, const Ellipse& around)
    : GroundRing(image, around.center_px, around.semi_major_px + kBeyond_px) {}

GroundRing::GroundRing(const cv::Mat& image, const Eigen::Vector2d& center_px, double radius_px) {
  if (image.cols < 3 || image.rows < 3) return;
  for (int k = 0; k < kSamples; ++k) {
    const double t = 2 * std::numbers::pi * k / (kSamples / 2.0);
    const double r = radius_px + (k < kSamples / 2 ? 0 : kApart_px);
    gray_[static_cast<std::size_t>(k)] =
        gray_at(image, center_px.x() + r * std::cos(t), center_px.y() + r * std::sin(t));
  }
}

// Pearson's correlation: another lamp is no other ground.
bool GroundRing::same_ground(const GroundRing& later, double least) const {
  double a = 0;
  double b = 0;
  double aa = 0;
  double bb = 0;
  double ab = 0;
  for (std::size_t k = 0; k < gray_.size(); ++k) {
    const double x = gray_[k];
    const double y = later.gray_[k];
    a += x, b += y, aa += x * x, bb += y * y, ab += x * y;
  }
  const auto n = static_cast<double>(gray_.size());
  const double var_a = aa / n - a * a / (n * n);
  const double var_b = bb / n - b * b / (n * n);
  if (std::min(var_a, var_b) < kStructure * kStructure) return false;
  return (ab / n - a * b / (n * n)) / std::sqrt(var_a * var_b) > least;
}

}  // namespace vitreo::vision
