// Convex parts of a body, and where a line touches them: closed forms with exact derivatives.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

namespace vitreo::optics {

/// A ball or a cylinder (along its z, with flat ends), stretched by its semi-axes: an ellipsoid, a
/// rod, a disc, an elliptical plate.
struct BodyPart {
  enum class Kind { ball, cylinder };
  Kind kind = Kind::ball;
  Eigen::Vector3d semi_axes{1e-3, 1e-3, 1e-3};                // m
  Eigen::Vector3d center{0, 0, 0};                            // m, in the body's frame
  Eigen::Matrix3d orientation = Eigen::Matrix3d::Identity();  // body_from_part
  void check() const;  // throws std::invalid_argument naming the parameter
};

namespace detail {

/// A part that has grown about its center until it just touches a line. The body's frame.
struct Tangency {
  /// Factor of the growth: below 1 the line passes through the part, at 1 it belongs to the part's
  /// outline. Convex in the line's place, and of first degree in its distance from the center.
  double gauge = 0;
  Eigen::Vector3d normal{0, 0, 1};  // unit, outward, across the line
  Eigen::Vector3d point{0, 0, 0};   // m; of the grown part, on the line
  double support = 0;               // m: normal . (surface - center) before it grew
  /// m, signed: between the line and the parallel one that touches the part. Positive outside.
  double distance() const { return (gauge - 1) * support; }
};

/// The line through `origin` (m) along `direction` (of any length), both in the body's frame. A
/// displacement x of the line at `point` changes the gauge by normal . x / support, exactly.
Tangency touch(const BodyPart& part, const Eigen::Vector3d& origin,
               const Eigen::Vector3d& direction);

}  // namespace detail
}  // namespace vitreo::optics
