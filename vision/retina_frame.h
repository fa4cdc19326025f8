// Retina frame: a frame flattened to a pyramid, a frame of the map with the points that carry its
// structure, and the alignment of the one with the other.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "vision/retina_map.h"

#include <opencv2/core/mat.hpp>

#include <array>
#include <optional>
#include <span>
#include <vector>

namespace vitreo::vision {

constexpr int kMapLevels = 3;  // half, quarter and eighth of the resolution

/// A point of one level with what a step of (turn, u, v, scale) changes there.
struct MapPoint {
  float u;
  float v;
  float value;
  Eigen::Matrix<float, 4, 1> slope;
};

struct MapLevel {
  cv::Mat image;  // CV_32F, flattened, deviation about 1
  cv::Mat valid;  // CV_8U
};

using MapPyramid = std::array<MapLevel, kMapLevels>;

/// Light over its local mean, in half, quarter and eighth of the resolution; false of a blank
/// frame. `flatten_px`, `bodies`: as RetinaMap has them.
bool make_pyramid(const cv::Mat& whole, std::span<const Ellipse> bodies, double flatten_px,
                  MapPyramid& pyramid);

/// A frame that the map is made of.
struct MapFrame {
  std::array<std::vector<MapPoint>, kMapLevels> points;
  cv::Mat spectrum;  // of the coarsest level
  Eigen::Affine2d map_from_frame = Eigen::Affine2d::Identity();
  double sigma_px = 0;  // of that
};
MapFrame make_frame(const MapPyramid& pyramid, const Eigen::Affine2d& map_from_frame,
                    double sigma_px);

/// Twice the size, so that a shift beyond half the view is not aliased.
cv::Mat map_spectrum(const MapLevel& level);

struct Alignment {
  Eigen::Affine2d image_from_frame = Eigen::Affine2d::Identity();  // full resolution
  double sigma_px = 0;
  double correlation = 0;
  double overlap = 0;
  bool sound = false;
};

/// Coarse to fine from a guess that is right within some pixels of the coarsest level.
Alignment align(const MapFrame& frame, const MapPyramid& image, const Eigen::Affine2d& guess,
                const RetinaMapSettings& settings);

/// A guess without any: the shift of the highest phase correlation (Kuglin & Hines 1975), whitened
/// by three quarters; `spectrum` of the image's coarsest level.
Eigen::Affine2d shift_of(const MapFrame& frame, const cv::Mat& spectrum);

}  // namespace vitreo::vision
