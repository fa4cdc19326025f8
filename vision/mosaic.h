// Retinal mosaic: one picture from many views of a sensor that rotates or translates in the aerial
// image (thesis A.1).
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "vision/mosaic_plan.h"

#include <Eigen/Geometry>
#include <opencv2/core/mat.hpp>

#include <span>
#include <vector>

namespace vitreo::vision {

/// Poses of the views, by all links together (Ceres). The first joined view keeps its own frame.
/// Neighbors in time are tried first, then all before. Throws std::invalid_argument for fewer than
/// two views, or of different size or type.
MosaicPlan plan_mosaic(std::span<const cv::Mat> views, const MosaicSettings& settings = {});

struct Mosaic {
  cv::Mat image;  ///< of the views' type
  cv::Mat cover;  ///< CV_8U: 255 where any view covers the mosaic
  Eigen::Affine2d image_from_mosaic = Eigen::Affine2d::Identity();
  std::vector<double> gains;  ///< factor on each view's gray levels; 1 for those left out
};

/// Views weighted towards their middle, evened in brightness where they overlap. Throws
/// std::invalid_argument when the plan is not of these views, std::length_error when the mosaic
/// would have more than max_pixels.
Mosaic blend_mosaic(std::span<const cv::Mat> views, const MosaicPlan& plan,
                    const MosaicSettings& settings = {});

}  // namespace vitreo::vision
