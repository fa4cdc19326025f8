// Placement of a surface off the axis: decenter and tilt; the frame of a surface.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

namespace vitreo::optics {

/// Where a surface stands against its place on the axis: its vertex is moved by `decenter`, and the
/// surface is then turned about that vertex by R = Rx(tilt.x) Ry(tilt.y) Rz(tilt.z), right-handed:
/// about x first, then about the new y, then about the new z (as a coordinate break of OpticStudio
/// does).
struct Placement {
  Eigen::Vector3d decenter{0, 0, 0};  // m, eye frame
  Eigen::Vector3d tilt{0, 0, 0};      // rad
  bool is_none() const { return decenter.isZero(0) && tilt.isZero(0); }
  Eigen::Matrix3d rotation() const;
};

/// The tilt of which `rotation` is made: the inverse of Placement::rotation for |tilt.y| < pi / 2.
Eigen::Vector3d tilt_of(const Eigen::Matrix3d& rotation);

/// Pose of a surface: points of its own frame (origin at its vertex, z along its axis) in the eye
/// frame.
struct SurfaceFrame {
  Eigen::Matrix3d axes = Eigen::Matrix3d::Identity();  // eye_from_surface
  Eigen::Vector3d origin{0, 0, 0};                     // m, its vertex in the eye frame
  Eigen::Vector3d to_local(const Eigen::Vector3d& point) const {
    return axes.transpose() * (point - origin);
  }
  Eigen::Vector3d to_eye(const Eigen::Vector3d& point) const { return axes * point + origin; }
};

}  // namespace vitreo::optics
