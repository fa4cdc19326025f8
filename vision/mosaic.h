// Retinal mosaic: one picture from many views of a sensor that rotates or translates in the aerial
// image (thesis A.1).
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "vision/registration.h"

#include <Eigen/Geometry>
#include <opencv2/core/mat.hpp>

#include <optional>
#include <span>
#include <vector>

namespace vitreo::vision {

struct MosaicSettings {
  RegistrationSettings registration;
  /// Views that overlap by this share are linked, neighbors in time or not.
  double link_overlap = 0.25;
  int links_per_view = 6;   ///< of those the ones with the largest overlap
  double max_pixels = 4e7;  ///< of the mosaic
  void check() const;       ///< throws std::invalid_argument naming the setting
};

struct MosaicLink {
  int first = 0;   ///< view
  int second = 0;  ///< view, later than first
  Registration registration;
  /// Between the views' adjusted poses and this registration, over the overlap.
  double rms_px = 0;
  bool used = true;  ///< false: contradicts the others, and was left out
};

struct MosaicPlan {
  /// Nothing for a view that could not be joined to the largest group.
  std::vector<std::optional<Eigen::Affine2d>> mosaic_from_view;
  std::vector<MosaicLink> links;
  /// Redundant links, beyond a spanning tree: with none, rms_px is 0 and carries no information.
  int spare_links = 0;
  double rms_px = 0;    ///< of the used links: how well the views agree on one plane
  double worst_px = 0;  ///< of one used link
  double sigma_px = 0;  ///< of one registration, from the noise, root mean square
  int joined() const;
};

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
