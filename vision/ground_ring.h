// Ground ring: the ground around a candidate, by which one that moves over the ground is told from
// anatomy, which moves with it.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "vision/ellipse.h"

#include <opencv2/core/mat.hpp>

#include <array>

namespace vitreo::vision {

/// Gray levels at places that lie fixed to the ellipse's center, beyond its rim and its shadow.
/// Nothing is allocated.
class GroundRing {
 public:
  static constexpr int kSamples = 64;
  GroundRing() = default;
  /// `image` as ColorTracker::update takes it.
  GroundRing(const cv::Mat& image, const Ellipse& around);
  /// On circles of `radius_px` and of 8 px more.
  GroundRing(const cv::Mat& image, const Eigen::Vector2d& center_px, double radius_px);
  /// Whether `later` shows the same ground: then the ellipse's content moved with it, or neither
  /// moved. False where there is no structure to tell, or their correlation is not above `least`.
  bool same_ground(const GroundRing& later, double least = kSame) const;
  static constexpr double kSame = 0.75;
  /// Whether there is structure to tell by: it is at least like itself.
  bool tells() const { return same_ground(*this); }

 private:
  std::array<float, kSamples> gray_{};
};

}  // namespace vitreo::vision
