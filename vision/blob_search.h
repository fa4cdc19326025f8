// Blob detection: the largest foreground component that can be the robot, roughly.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "vision/background.h"
#include "vision/ellipse.h"

#include <opencv2/core/mat.hpp>

#include <optional>

namespace vitreo::vision {

struct BlobLimits {
  double min_semi_minor_px = 6;
  double max_semi_major_px = 200;
  double threshold_sigma = 6;
  double min_contrast = 8;
};

struct Blob {
  Ellipse ellipse;
  double area_px = 0;
  bool cut = false;  ///< touches the border of the searched region, and the image goes on there
};

class BlobSearch {
 public:
  BlobSearch(const Background& background, const BlobLimits& limits);
  /// Reads every `step`-th pixel and row of `where`, which lies in the image.
  std::optional<Blob> largest(const cv::Mat& image, const cv::Rect& where, int step) const;

 private:
  cv::Mat mask(const cv::Mat& image, const cv::Rect& where, int step) const;
  BlobLimits limits_;
  // CV_8U: gray levels from low_ to high_ are the background's.
  cv::Mat low_;
  cv::Mat high_;
};

}  // namespace vitreo::vision
