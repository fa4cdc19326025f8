// Pictures for people.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>
#include <vector>

#include <opencv2/core/mat.hpp>

#include "vision/ellipse.h"

namespace vitreo::vision {

struct Overlay {
  std::optional<Ellipse> tracked;            ///< drawn solid with centre cross and major axis
  std::optional<Ellipse> expected;           ///< drawn dashed: where the estimated pose would show
  std::vector<Eigen::Vector2d> trail_px;     ///< where it has been
  std::optional<Eigen::Vector2d> target_px;  ///< drawn as a ring
  double scale_bar_px = 0;                   ///< length of the scale bar; 0 = none
  std::string scale_bar_label;               ///< e.g. "1 mm at the aerial image"
};

/// The grey image in colour (CV_8UC3, BGR) with the overlay on it; lines keep their weight whatever the image's size.
cv::Mat draw_overlay(const cv::Mat& grey, const Overlay& overlay);

/// Crops to `size` around `centre_px`, moved inside the image where it would stick out.
cv::Mat crop_around(const cv::Mat& image, const Eigen::Vector2d& centre_px, cv::Size size);

}  // namespace vitreo::vision
