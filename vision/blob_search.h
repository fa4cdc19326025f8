// Where something stands before the ground: the largest patch that can be the robot, roughly.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "vision/background.h"
#include "vision/ellipse.h"

#include <opencv2/core/mat.hpp>

#include <optional>

namespace vitreo::vision {

struct BlobLimits {
  double min_semi_minor_px = 6, max_semi_major_px = 200;
  double threshold_sigma = 6, min_contrast = 8;
};

struct Blob {
  Ellipse ellipse;
  double area_px = 0;
  bool cut = false;  ///< reaches the border of where was looked, and the image goes on there
};

class BlobSearch {
 public:
  BlobSearch(const Background& background, const BlobLimits& limits);
  /// Looks at every `step`-th pixel and row of `where`, which lies in the image.
  std::optional<Blob> largest(const cv::Mat& image, const cv::Rect& where, int step) const;

 private:
  cv::Mat mask(const cv::Mat& image, const cv::Rect& where, int step) const;
  BlobLimits limits_;
  cv::Mat low_, high_;  // CV_8U: gray levels between these are the ground's
};

}  // namespace vitreo::vision
