// Blob tracker: background subtraction and ellipse (thesis section 5.5), with a sub-pixel contour.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "vision/background.h"
#include "vision/ellipse.h"

#include <opencv2/core/mat.hpp>

#include <memory>
#include <optional>

namespace vitreo::vision {

struct BlobTrackerSettings {
  /// Size that can be the robot's.
  double min_semi_minor_px = 6;
  double max_semi_major_px = 200;
  /// A pixel is foreground beyond this many standard deviations of its own noise.
  double threshold_sigma = 6;
  double min_contrast = 8;  ///< gray levels
  int normals = 64;         ///< contour samples; a multiple of 4
  double search_px = 8;     ///< along each normal, either way
  /// Of the imaging, about: estimated anew in each image, 0.4 to 2.5 times this, or to 6.
  double blur_sigma_px = 2.0;
  /// The body has flat ends, as a cylinder: its rim is no ellipse, which is then the least-squares
  /// one through all of it, and the contour the rim itself to a tenth of a pixel.
  bool corners = false;
  void check() const;  ///< throws std::invalid_argument naming the setting
};

/// The rim is first taken where the normals cross half the contrast to the ground, then refined by
/// comparing each normal with what a shaded body, curved and blurred, would show before that ground
/// (vision/contour.h): the bias of a full axis stays within 0.5 px for bodies of 30 px and more.
class BlobTracker {
 public:
  BlobTracker(Background background, const BlobTrackerSettings& settings);
  ~BlobTracker();
  /// The robot in this image, or nothing. Searches near its last position first, else the whole
  /// image. Throws std::invalid_argument when the image's size or type differs from the
  /// background's.
  std::optional<EllipseMeasurement> update(const cv::Mat& image);
  void reset();  ///< forgets the last position

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace vitreo::vision
