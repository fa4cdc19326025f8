// Background model: mean image of the empty scene and the pixel noise at each gray level. Learnt
// once, before the robot is in, so that a robot that holds still is never absorbed.
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
  /// CV_32F, gray levels. Throws std::logic_error before the first image.
  const cv::Mat& mean() const;
  /// Standard deviation of one image's pixel noise, gray levels, pooled over the image by gray
  /// level (256 entries, CV_32F 1x256): the square root of a line in the level, read noise and shot
  /// noise (background.cpp).
  const cv::Mat& noise_of_level() const;

 private:
  int count_ = 0;
  cv::Mat sum_;
  cv::Mat sum_of_squares_;
  mutable cv::Mat mean_;
  mutable cv::Mat noise_;
};

}  // namespace vitreo::vision
