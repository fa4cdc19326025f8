// Object masks from an operator's outline: ellipses, polygons, points on and off the object.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "vision/ellipse.h"

#include <opencv2/core/mat.hpp>

#include <vector>

namespace vitreo::vision {

struct MaskOutline {
  std::vector<Ellipse> ellipses;
  std::vector<std::vector<Eigen::Vector2d>> polygons_px;
  std::vector<Eigen::Vector2d> on_px;   ///< points that are surely on the object
  std::vector<Eigen::Vector2d> off_px;  ///< points that are surely not
};

/// CV_8UC1, 255 within any of the outlines: pixels whose center is inside. Throws
/// std::invalid_argument for none, for an ellipse without axes, a polygon with fewer than three
/// corners, or when no pixel of the image is inside.
cv::Mat mask_of(const MaskOutline& outline, const cv::Size& size);

/// Segmentation of the object in the image (CV_8UC3) by its colors, around a rough mask: GrabCut
/// (Rother, Kolmogorov & Blake 2004) in which nothing farther than `margin_px` outside of the rough
/// mask, or near an off-point, can be the object, and what is deeper than that inside, or near an
/// on-point, surely is. Its largest part, without holes. Repeatable: OpenCV's generator gets a
/// fixed seed. Throws std::invalid_argument for another type, a mask of another size, or when
/// nothing is left.
cv::Mat cut_by_color(const cv::Mat& image, const cv::Mat& rough, const MaskOutline& points,
                     double margin_px);

/// The outer rims of a mask's parts, for drawing.
std::vector<std::vector<Eigen::Vector2d>> contours_of(const cv::Mat& mask);

}  // namespace vitreo::vision
