// Where an ellipsoid of known size and orientation is, from the one ellipse it shows: thesis 5.3, minimising (5.15).
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>

#include <Eigen/Core>

#include "optics/single_viewpoint.h"

namespace vitreo::optics {

/// An ellipse in an image: centre u, centre v, semi-major, semi-minor (px), angle of the major axis from +u towards +v (rad).
using EllipseVector = Eigen::Matrix<double, 5, 1>;
using EllipseCovariance = Eigen::Matrix<double, 5, 5>;

/// An ellipsoid of revolution: the robot as the localiser knows it.
struct Spheroid {
  double semi_axis = 1e-3;    // m, along its axis
  double semi_radius = 0.5e-3;  // m, across
};

struct PoseSettings {
  SingleViewpoint projection;
  ImageScale image;
  Spheroid robot;
  double angle_weight = 0.1;     // of the angle term in (5.15), in units of the half difference of the axes: field knows it better
  int contour_points = 24;       // on the model's silhouette
  double max_residual_px = 8;    // above this rms the answer is "nothing"
};

struct PoseEstimate {
  Eigen::Vector3d position_in_eye;      // m
  Eigen::Matrix3d covariance;           // m^2, from the observation's covariance
  double residual_px = 0;               // rms of the weighted terms of (5.15)
  int iterations = 0;
};

/// The ellipse that the robot at `position_in_eye` with its axis along `axis_in_eye` shows; nothing outside the projection.
std::optional<EllipseVector> project_spheroid(const PoseSettings& settings, const Eigen::Vector3d& position_in_eye,
                                              const Eigen::Vector3d& axis_in_eye);

/// Minimises (5.15) over the position, from `start_in_eye`. Nothing when it does not converge, leaves the projection's
/// validity, or fits badly. `covariance` is that of `observed`.
std::optional<PoseEstimate> locate(const PoseSettings& settings, const EllipseVector& observed,
                                   const EllipseCovariance& covariance, const Eigen::Vector3d& axis_in_eye,
                                   const Eigen::Vector3d& start_in_eye);

/// A start for `locate` without a previous estimate: the centre's line of sight, the depth at which the size fits.
std::optional<Eigen::Vector3d> first_guess(const PoseSettings& settings, const EllipseVector& observed,
                                           const Eigen::Vector3d& axis_in_eye);

}  // namespace vitreo::optics
