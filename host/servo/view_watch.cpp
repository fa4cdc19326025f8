// SPDX-License-Identifier: Apache-2.0
#include "host/servo/view_watch.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace vitreo {
namespace {

constexpr double kViewPoints = 10000;  // about so many
// Standard deviations, and gray levels: farther from the scene a pixel is something else. The
// levels are for shadows and for light that breathes.
constexpr float kViewOther = 6;
constexpr float kViewOtherLevels = 8;
// Of the picture: a robot, its shadow, a tool and a floater are less.
constexpr double kViewMostChanged = 0.12;
// px: a camera was knocked; and standard deviations.
constexpr double kViewMostShift = 1.5;
constexpr double kViewSure = 8;

}  // namespace

ViewWatch::ViewWatch(const vision::Background& background) {
  const cv::Mat& mean = background.mean();
  const cv::Mat& noise = background.noise_of_level();
  size_ = mean.size();
  const int step = std::max(1, static_cast<int>(std::sqrt(mean.cols * mean.rows / kViewPoints)));
  for (int v = step; v + 1 < mean.rows; v += step)
    for (int u = step; u + 1 < mean.cols; u += step) {
      const float level = mean.at<float>(v, u);
      const int bin = std::clamp(static_cast<int>(std::lround(level)), 0, noise.cols - 1);
      points_.push_back({u, v, level, std::max(0.3F, noise.at<float>(0, bin)),
                         (mean.at<float>(v, u + 1) - mean.at<float>(v, u - 1)) / 2,
                         (mean.at<float>(v + 1, u) - mean.at<float>(v - 1, u)) / 2});
    }
}

// A scene moved by s shows level - grad . s: with w = 1 / noise^2
//   s = -(sum w g g')^-1 sum w g (seen - level).
ViewChange ViewWatch::look(const cv::Mat& gray) const {
  ViewChange found;
  double others = 0;
  double a = 0, b = 0, c = 0, x = 0, y = 0;
  for (const Point& one : points_) {
    const float apart = static_cast<float>(gray.at<unsigned char>(one.v, one.u)) - one.level;
    const float slope = std::abs(one.du) + std::abs(one.dv);
    // Where the scene is steep a small shift is a large difference.
    if (std::abs(apart) > std::max(kViewOther * one.noise, kViewOtherLevels) + 2 * slope) {
      ++others;
      continue;
    }
    const double weight = 1 / (one.noise * one.noise);
    a += weight * one.du * one.du;
    b += weight * one.du * one.dv;
    c += weight * one.dv * one.dv;
    x -= weight * one.du * apart;
    y -= weight * one.dv * apart;
  }
  found.changed = points_.empty() ? 0 : others / static_cast<double>(points_.size());
  const double determinant = a * c - b * b;
  if (!(determinant > 1e-9 * a * c)) {
    found.shift_sigma_px = 1e9;  // a scene without structure shows no shift
    return found;
  }
  found.shift_px = {(c * x - b * y) / determinant, (a * y - b * x) / determinant};
  found.shift_sigma_px = std::sqrt(std::max(a, c) / determinant);
  return found;
}

std::string ViewWatch::fault(const cv::Mat& gray) const {
  if (gray.size() != size_) return {};  // the tracker refuses it
  const ViewChange change = look(gray);
  if (change.changed > kViewMostChanged)
    return fmt::format(
        "{:.0f} % of its picture is not the empty scene that was learnt: the camera was moved, "
        "turned or mirrored, or light or exposure changed",
        100 * change.changed);
  const double shift = std::hypot(change.shift_px.x, change.shift_px.y);
  if (shift > kViewMostShift && shift > kViewSure * change.shift_sigma_px)
    return fmt::format(
        "the empty scene is {:.1f} px from where it was learnt: the camera was moved", shift);
  return {};
}

}  // namespace vitreo
