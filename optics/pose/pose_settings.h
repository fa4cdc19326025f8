// Settings of the localization of a spheroid by pose: projection, image scale, body and the weights
// of (5.15).
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/projection/exact_projection.h"
#include "optics/projection/single_viewpoint.h"

#include <Eigen/Core>

#include <optional>

namespace vitreo::optics {

/// An ellipse in an image: center u, center v, semi-major, semi-minor (px), angle of the major axis
/// from +u towards +v (rad).
using EllipseVector = Eigen::Matrix<double, 5, 1>;
using EllipseCovariance = Eigen::Matrix<double, 5, 5>;

/// An ellipsoid of revolution: the robot as the localizer models it.
struct Spheroid {
  double semi_axis = 1e-3;      // m, along its axis
  double semi_radius = 0.5e-3;  // m, across
};

struct PoseSettings {
  SingleViewpoint projection;
  ImageScale image;
  Spheroid robot;
  // of the angle term in (5.15), in units of the half difference of the axes: the field's direction
  // is known better
  double angle_weight = 0.1;
  int contour_points = 24;     // on the model's silhouette, 8 to 64
  double max_residual_px = 8;  // above this rms the answer is "nothing"
  /// m: an estimate may lie so far behind the retina, where no robot can be. What is known of the
  /// bench is in the depth, and a robot that rests on the retina is found below it as often as not.
  double behind_retina = 0;
  /// When given, silhouettes are seen along the exact isopixel lines, and `projection` is not used:
  /// no error of the simplification is left.
  std::optional<ExactProjection> exact{};
  /// Least squares weighted by the observation's covariance in place of (5.15): the most probable
  /// position when that is right. The angle has no weight where the ellipse is round;
  /// `angle_weight` is not used.
  bool weighted = false;
  void check() const;  // throws std::invalid_argument naming the parameter
};

namespace detail {

inline constexpr int kMaxContourPoints = 64;

/// Throws std::invalid_argument naming `observed` unless it is finite with semi-major >= semi-minor
/// > 0.
void check_ellipse(const EllipseVector& observed);

}  // namespace detail
}  // namespace vitreo::optics
