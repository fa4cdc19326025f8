// Statistical shape model: mean and eigenshapes (8.3) of the signed distances of registered masks,
// and the most probable shape given a front (8.4).
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "vision/ellipse.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include <array>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace vitreo::vision {

/// A pixel near the front and its signed distance to it, px, negative inside.
struct FrontPoint {
  float u = 0;
  float v = 0;
  float distance = 0;
};

constexpr int kMaxModes = 4;

struct ShapePose {
  Eigen::Vector2d center_px{0, 0};
  double angle = 0;     ///< rad, of the model's x axis, from +u towards +v
  double scale_px = 0;  ///< radius of the circle of the shape's area
};

struct ShapeFit {
  ShapePose pose;
  /// a_i of (8.3), in units of the mode's standard deviation.
  std::array<double, kMaxModes> weights{};
  double inlier_fraction = 0;  ///< inliers: share of the points within the robust norm
  /// Of (8.5), up to a constant: the robust (8.6), (8.8), and the motion prior in place of (8.9).
  /// As inlier_fraction, of the pose and weights before the last step.
  double log_posterior = 0;
};

struct ShapeFitSettings {
  int iterations = 6;
  /// Scale of the Tukey norm, narrowing from one to the other.
  double first_px = 8;
  double last_px = 2.5;
  int max_points = 128;  ///< of the front that are used, evenly spread over the list
  /// Standard deviations of the motion prior (scale: of its logarithm); (8.9) is their limit.
  double center_px = 6;
  double angle = 0.15;
  double scale = 0.08;
};

class ShapeModel;

/// phi* of (8.3) at its pose, px, negative inside.
class PlacedShape {
 public:
  PlacedShape(const ShapeModel& model, const ShapeFit& fit);
  double at(double u, double v) const;

 private:
  const ShapeModel* model_;
  ShapeFit fit_;
  std::array<float, 8> factors_;  // of a sample's mean and modes
  double cos_;
  double sin_;
};

class ShapeModel {
 public:
  static constexpr int kGrid = 96;       // samples along each side of the signed distance
  static constexpr double kReach = 2.6;  // half side of the grid, in units of the shape's scale
  using Sample = std::array<float, 8>;   // mean, then the modes times their standard deviation

  /// Registers the masks by centroid, major axis and area (the thesis registers the surfaces by
  /// image correlation), then takes the principal components of their signed distances. Throws
  /// std::invalid_argument for none, or for a mask that is not CV_8UC1, empty or full.
  static ShapeModel train(std::span<const cv::Mat> masks);
  std::string save() const;
  /// Throws std::invalid_argument for anything that save() did not write.
  static ShapeModel load(std::string_view bytes);

  /// The pose and weights of highest posterior (8.4), around `predicted`. The histogram term (8.7)
  /// is not evaluated: colors act through the front, which F has driven.
  ShapeFit fit(std::span<const FrontPoint> front, const ShapePose& predicted,
               const ShapeFitSettings& settings) const;
  /// The ellipse with the moments of the fitted shape's inside.
  Ellipse ellipse_of(const ShapeFit& fit) const;
  ShapePose pose_of(const Ellipse& ellipse) const;

  int modes() const { return modes_; }
  /// Eigenvalues of (8.8): of the registered signed distances in units of the scale.
  const std::array<double, kMaxModes>& eigenvalues() const { return eigenvalues_; }
  double explained() const { return explained_; }  ///< share of the variance that the modes hold
  const std::vector<Sample>& samples() const { return samples_; }

 private:
  int modes_ = 0;
  double explained_ = 0;
  std::array<double, kMaxModes> eigenvalues_{};
  void find_reach();

  std::vector<Sample> samples_;
  std::array<std::pair<int, int>, kGrid> reach_{};  // columns of each row that a fit may cover
};

}  // namespace vitreo::vision
