// Drawing of tracking results on images, and crops of images.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "vision/ellipse.h"

#include <opencv2/core/mat.hpp>

#include <optional>
#include <string>
#include <vector>

namespace vitreo::vision {

struct Overlay {
  std::optional<Ellipse> tracked;         ///< drawn solid with center cross and major axis
  std::optional<Ellipse> expected;        ///< drawn dashed: where the estimated pose would appear
  std::vector<Eigen::Vector2d> trail_px;  ///< past centers
  std::optional<Eigen::Vector2d> target_px;  ///< drawn as a ring
  double scale_bar_px = 0;                   ///< length of the scale bar; 0 = none
  std::string scale_bar_label;               ///< e.g. "1 mm at the aerial image"
  /// Of the tracked center, px^2: its 95 % ellipse is drawn ten times as large, to be visible.
  std::optional<Eigen::Matrix2d> covariance_px2;
  std::vector<std::vector<Eigen::Vector2d>> contours_px;  ///< closed lines
  std::string caption;  ///< at the top left, such as the tracker's state
};

/// The 8-bit image, gray or BGR (else std::invalid_argument), in color (CV_8UC3, BGR) with the
/// overlay on it; lines keep their weight whatever the image's size.
cv::Mat draw_overlay(const cv::Mat& image, const Overlay& overlay);

/// Crops to `size` (or the image, where that is smaller) around `center_px`, moved inside the image
/// where it would stick out. Throws std::invalid_argument for an empty image or size.
cv::Mat crop_around(const cv::Mat& image, const Eigen::Vector2d& center_px, cv::Size size);

}  // namespace vitreo::vision
