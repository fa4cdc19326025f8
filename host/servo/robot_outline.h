// Body of the robot as its outline shows it, and its localization by the contour of one frame.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/robot.h"
#include "optics/pose/object_pose.h"
#include "vision/ellipse.h"

#include <Eigen/Core>

#include <optional>

namespace vitreo {

/// Whether the robot is a cylinder or a disc, whose ellipse no spheroid of its size shows. A helix
/// is not: for the optics it is the spheroid about it.
bool has_flat_ends(const control::Robot& robot);

/// The body of convex parts that a robot of this shape shows: two crossed plates as thick as its
/// metal's volume makes them, a cylinder, a disc. Nothing for bodies whose outline is an ellipse's,
/// and for a helix, of which the optics know the spheroid about it.
std::optional<optics::ObjectModel> outlined_body(const control::Robot& robot);

/// A pose found from a contour.
struct OutlinePose {
  Eigen::Vector3d position_in_eye;  // m
  Eigen::Matrix3d attitude;         // body to eye, its third axis the robot's
  Eigen::Matrix3d noise;            // m^2, of the position: another in each frame
  Eigen::Matrix3d stays;            // m^2: of attitude and outline, while the robot does not turn
  Eigen::Matrix3d axis_covariance;  // rad^2, of the axis along directions across it; eye frame
  double residual_px = 0;
};

/// Maximum a posteriori position, axis and turn about the axis, by the distances of the contour's
/// points from the body's outline (optics::locate_outline).
class OutlineLocalizer {
 public:
  /// `settings`: the projection, and the body. `attitude_sigma` (rad, above 0): of what is expected
  /// of the attitude, about each of the body's axes. `outline_error_px`: what stays wrong of the
  /// outline's semi-axes beside their noise; attitude and outline weigh by it against each other.
  OutlineLocalizer(optics::ObjectPoseSettings settings, double attitude_sigma,
                   double outline_error_px);
  /// The pose that the contour shows near `start_in_eye`. Nothing where too little of a contour is
  /// there or no pose was found: then the ellipse has to do.
  std::optional<OutlinePose> locate(const vision::EllipseMeasurement& seen,
                                    const Eigen::Vector3d& start_in_eye,
                                    const Eigen::Matrix3d& expected) const;

 private:
  optics::ObjectPoseSettings settings_;
  double outline_error_px_;
};

}  // namespace vitreo
