// Picture of a retina map as it grows, and frames with the retina at rest.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "vision/retina_map.h"

#include <opencv2/core/mat.hpp>

namespace vitreo::vision {

/// The picture of a map as it grows: frames laid over each other by their poses, each weighed
/// towards its middle.
class RetinaPicture {
 public:
  /// At most `max_pixels` altogether: what lies beyond is left out.
  explicit RetinaPicture(double max_pixels = 2e7) : max_pixels_(max_pixels) {}
  /// Throws std::invalid_argument for another type than the first frame's.
  void add(const cv::Mat& image, const Eigen::Affine2d& map_from_image);
  /// Of the frames' type; empty before the first.
  cv::Mat image() const;
  /// Pixel of image() for a point of the map.
  Eigen::Vector2d pixel_of(const Eigen::Vector2d& in_map) const { return in_map - origin_; }

 private:
  bool make_room(const cv::Rect& wanted);
  double max_pixels_;
  int type_ = -1;
  Eigen::Vector2d origin_{0, 0};  // of the first pixel, in the map
  cv::Mat sum_;                   // CV_32FC1 or C3, weighed
  cv::Mat weight_;                // CV_32FC1
};

/// A frame as the map's first frame saw it: the retina stands still in it. Of the same size.
cv::Mat stabilized(const cv::Mat& image, const RetinaPose& pose);

}  // namespace vitreo::vision
