// Background subtraction and ellipse: the tracker of thesis 5.5, with a contour at half contrast to a fraction of a pixel.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <optional>

#include <opencv2/core/mat.hpp>

#include "vision/background.h"
#include "vision/ellipse.h"

namespace vitreo::vision {

struct BlobTrackerSettings {
  double min_semi_minor_px = 6, max_semi_major_px = 200;  ///< what can be the robot
  double threshold_sigma = 6;      ///< a pixel is foreground beyond this many standard deviations of its own noise
  double min_contrast = 8;         ///< grey levels
  int normals = 64;                ///< contour samples
  double search_px = 8;            ///< along each normal, either way
  double blur_sigma_px = 2.0;      ///< of the imaging; the half-contrast contour's curvature bias is taken back with it
  void check() const;              ///< throws std::invalid_argument naming the setting
};

class BlobTracker {
 public:
  BlobTracker(Background background, const BlobTrackerSettings& settings);
  ~BlobTracker();
  /// The robot in this image, or nothing. Looks near the last place first, else in the whole image. Throws
  /// std::invalid_argument when the image's size or type differs from the background's.
  std::optional<EllipseMeasurement> update(const cv::Mat& image);
  void reset();  ///< forgets where it was

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace vitreo::vision
