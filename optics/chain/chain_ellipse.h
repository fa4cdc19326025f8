// Ellipse of the robot as the viewing chain shows it, with derivatives by place, axis and every
// parameter of the chain.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/chain/viewing_chain.h"
#include "optics/pose/pose_settings.h"

#include <Eigen/Core>

#include <optional>

namespace vitreo::optics {

/// An ellipse in smooth coordinates, px: center u and v, (a + b) / 2, and (a - b) / 2 times cosine
/// and sine of twice the angle. They have no singular circle.
using SmoothEllipseVector = Eigen::Matrix<double, 5, 1>;

struct ShownEllipse {
  SmoothEllipseVector ellipse;
  Eigen::Matrix<double, 5, 3> by_position;            // px/m
  Eigen::Matrix<double, 5, 2> by_axis;                // px/rad, along the columns of `across`
  Eigen::Matrix<double, 5, Eigen::Dynamic> by_theta;  // px per sigma of the parameter
  Eigen::Matrix<double, 3, 2> across;  // unit directions across the axis and each other
};

/// A place of the robot: its center, the unit direction of its axis, and a pixel near which its
/// center is shown (its ellipse's center will do).
struct RobotPlace {
  Eigen::Vector3d position;  // m, nominal eye frame
  Eigen::Vector3d axis;
  Eigen::Vector2d near_px;
};

/// The silhouette of the nominal spheroid, or of two crossed plates that fill it (NominalChain), as
/// large as the chain's parameters make it, seen from
/// the point near which the lines past its center meet; the ellipse that a tracker fits to it, and
/// the outline's dilation. Nothing where the chain does not show all of it.
std::optional<SmoothEllipseVector> shown_ellipse(const ViewingChain& chain,
                                                 const RobotPlace& place);
std::optional<ShownEllipse> differentiated_ellipse(const ViewingChain& chain,
                                                   const RobotPlace& place);

/// To and from center, semi-axes and angle.
SmoothEllipseVector smooth_from(const EllipseVector& ellipse);
EllipseVector ellipse_from(const SmoothEllipseVector& smooth);

/// Two unit directions across a unit vector and each other.
Eigen::Matrix<double, 3, 2> directions_across(const Eigen::Vector3d& axis);

}  // namespace vitreo::optics
