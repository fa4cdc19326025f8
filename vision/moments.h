// Moment ellipse: the ellipse with the second moments of a set of pixels.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "vision/ellipse.h"

#include <opencv2/core/mat.hpp>

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace vitreo::vision {

struct MomentSums {
  std::int64_t count = 0;
  std::int64_t u = 0;
  std::int64_t v = 0;
  std::int64_t uu = 0;
  std::int64_t uv = 0;
  std::int64_t vv = 0;
  void add(std::int64_t x, std::int64_t y) {
    ++count;
    u += x, v += y, uu += x * x, uv += x * y, vv += y * y;
  }
  /// The pixels [first, end) of row `y`, by sums of powers in closed form.
  void add_run(std::int64_t first, std::int64_t end, std::int64_t y) {
    const std::int64_t n = end - first;
    const std::int64_t sum = (first + end - 1) * n / 2;
    // sum of k^2 below m: (m - 1) m (2 m - 1) / 6
    const auto squares = [](std::int64_t m) { return (m - 1) * m * (2 * m - 1) / 6; };
    count += n;
    u += sum, v += n * y, uu += squares(end) - squares(first), uv += sum * y, vv += n * y * y;
  }
  /// Of pixels counted from `origin`, each `pitch` wide. A uniform ellipse has the variance a^2 / 4
  /// along its semi-axis a, so a semi-axis is twice the standard deviation along it; axes and angle
  /// are the eigensystem of the 2 x 2 covariance in closed form.
  Ellipse ellipse(const Eigen::Vector2d& origin, double pitch = 1) const {
    if (count == 0) return {};
    const auto n = static_cast<double>(count);
    const double mu = static_cast<double>(u) / n;
    const double mv = static_cast<double>(v) / n;
    const double xx = static_cast<double>(uu) / n - mu * mu;
    const double yy = static_cast<double>(vv) / n - mv * mv;
    const double xy = static_cast<double>(uv) / n - mu * mv;
    const double mean = (xx + yy) / 2;
    const double spread = std::hypot((xx - yy) / 2, xy);
    const double angle = spread > 0 ? std::atan2(2 * xy, xx - yy) / 2 : 0;
    return {origin + pitch * Eigen::Vector2d(mu, mv),
            pitch * 2 * std::sqrt(std::max(mean + spread, 0.0)),
            pitch * 2 * std::sqrt(std::max(mean - spread, 0.0)), angle};
  }
};

inline MomentSums moments_of(const cv::Mat& mask) {
  MomentSums sums;
  for (int v = 0; v < mask.rows; ++v) {
    const auto* row = mask.ptr<unsigned char>(v);
    for (int u = 0; u < mask.cols; ++u) {
      if (row[u] != 0) sums.add(u, v);
    }
  }
  return sums;
}

}  // namespace vitreo::vision
