// Ellipse of the spheroid that stands for a body of another shape where only spheroids are known:
// in the thesis' localization (5.15) and in what is calibrated by it.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/pose/object_pose.h"

#include <Eigen/Core>

#include <optional>

namespace vitreo::optics {

/// What the spheroid with the semi-axes of `body.object`, a cylinder or a superquadric about its z,
/// would show where that body shows `seen`: the ellipses of both at `near_in_eye` (m) differ by as
/// much, in units of their size, as they do wherever the robot is seen alike. The axis is along
/// `axis_in_eye` (any length). Nothing where either is outside the projection. Throws
/// std::invalid_argument naming a bad argument.
std::optional<EllipseVector> as_of_spheroid(const ObjectPoseSettings& body,
                                            const EllipseVector& seen,
                                            const Eigen::Vector3d& axis_in_eye,
                                            const Eigen::Vector3d& near_in_eye);

/// The same without a position: at the depth where the size fits, on the line of sight of the
/// ellipse's center.
std::optional<EllipseVector> as_of_spheroid(const ObjectPoseSettings& body,
                                            const EllipseVector& seen,
                                            const Eigen::Vector3d& axis_in_eye);

}  // namespace vitreo::optics
