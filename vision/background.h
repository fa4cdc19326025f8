// What the empty scene looks like, and how much each pixel's gray value scatters. Learnt once,
// before the robot is in, so that a robot that holds still is never absorbed.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <opencv2/core/mat.hpp>

namespace vitreo::vision {

class Background {
 public:
  /// Adds one 8-bit gray image of the empty scene. Throws std::invalid_argument for another size or
  /// type.
  void learn(const cv::Mat& image);
  int count() const { return count_; }
  const cv::Mat& mean()
      const;  ///< CV_32F, gray levels. Throws std::logic_error before the first image.
  /// Standard deviation of one image's pixel noise, gray levels, pooled over the image by gray
  /// level (256 entries, CV_32F 1x256).
  const cv::Mat& noise_of_level() const;

 private:
  int count_ = 0;
  cv::Mat sum_, sum_of_squares_;
  mutable cv::Mat mean_, noise_;
};

}  // namespace vitreo::vision
