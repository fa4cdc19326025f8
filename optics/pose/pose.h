// Position of an ellipsoid of known size and orientation from the one ellipse that it shows: thesis
// 5.3, minimizing (5.15).
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/pose/pose_settings.h"

#include <Eigen/Core>

#include <optional>

namespace vitreo::optics {

struct PoseEstimate {
  Eigen::Vector3d position_in_eye;  // m
  Eigen::Matrix3d covariance;       // m^2, from the observation's covariance
  double residual_px = 0;           // rms of the terms of (5.15)
  int iterations = 0;
};

/// The ellipse that the robot at `position_in_eye` with its axis along `axis_in_eye` (any length,
/// either sense) shows: the one that a tracker fits to its silhouette by least squares of distances
/// from the ellipse. Angle in (-pi/2, pi/2]. Nothing when the position or a part of the silhouette
/// is outside the projection. Throws std::invalid_argument naming a bad argument.
std::optional<EllipseVector> project_spheroid(const PoseSettings& settings,
                                              const Eigen::Vector3d& position_in_eye,
                                              const Eigen::Vector3d& axis_in_eye);

/// The pixel that shows a point. Nothing where there is no image of it, in the lens, or behind the
/// retina by more than settings.behind_retina.
std::optional<Eigen::Vector2d> shown_at(const PoseSettings& settings,
                                        const Eigen::Vector3d& point_in_eye);

/// Minimizes (5.15) over the position, from `start_in_eye`. Nothing when it does not converge,
/// leaves the projection's validity, or fits badly. `covariance` is that of `observed`. Unless
/// `weighted` it does not weigh the terms, which are (5.15)'s own, but is carried through that
/// estimator: (J^T J)^-1 J^T C J (J^T J)^-1. Weighted: (J^T C^-1 J)^-1, and C must be positive
/// definite. Errors of the model or of the axis are not in it. Throws std::invalid_argument
/// naming a bad argument. Needs no heap.
std::optional<PoseEstimate> locate(const PoseSettings& settings, const EllipseVector& observed,
                                   const EllipseCovariance& covariance,
                                   const Eigen::Vector3d& axis_in_eye,
                                   const Eigen::Vector3d& start_in_eye);

/// m per unit: how the position that `locate` finds moves where something that it takes for known
/// is other than believed, to first order: both lie along the line of sight, and the second across
/// it too. What the errors of a stated size or scale do to a position, beside
/// PoseEstimate::covariance.
struct PoseSensitivity {
  Eigen::Vector3d size{0, 0, 0};   // the body larger by 1 of its size; right within 1 %
  Eigen::Vector3d pixel{0, 0, 0};  // the pixel larger by 1 of its width
};
/// At a position and axis that were found. Nothing where the position has no image or a direction
/// is not observed. Throws std::invalid_argument naming a bad argument.
std::optional<PoseSensitivity> pose_sensitivity(const PoseSettings& settings,
                                                const Eigen::Vector3d& position_in_eye,
                                                const Eigen::Vector3d& axis_in_eye);

/// A start for `locate` without a previous estimate: the center's line of sight, the depth at which
/// the size fits. An ellipse somewhat too small or too large for any depth gives the nearest end;
/// nothing when it is off by more than a fifth, or outside the projection. Throws
/// std::invalid_argument naming a bad argument.
std::optional<Eigen::Vector3d> first_guess(const PoseSettings& settings,
                                           const EllipseVector& observed,
                                           const Eigen::Vector3d& axis_in_eye);

}  // namespace vitreo::optics
