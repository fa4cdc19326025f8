// Bodies of known size, as the localizer models them: superquadrics, with ellipsoid, cylinder and
// box among them, two thin ellipsoids that cross, and unions of convex parts.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/pose/body_part.h"

#include <Eigen/Core>

#include <vector>

namespace vitreo::optics {

/// The superellipsoid of Barr (1981) in its own frame, origin at its center:
///   (|x/a|^(2/e2) + |y/b|^(2/e2))^(e2/e1) + |z/c|^(2/e1) = 1.
/// e1 = e2 = 1 is an ellipsoid; e1 = 0, e2 = 1 a cylinder along z with flat ends; both 0 a box.
struct ObjectModel {
  Eigen::Vector3d semi_axes{0.5e-3, 0.5e-3, 1e-3};  // a, b, c; m
  double exponent_along = 1;   // e1, 0 to 1.9: how square the profile along z is
  double exponent_across = 1;  // e2, 0 to 1.9: the section across z
  // two of this ellipsoid: the other has a and b exchanged (a soft robot's plates)
  bool crossed = false;
  /// When given, the body is the union of these, each of which holds the origin; the three above
  /// are not used.
  std::vector<BodyPart> parts{};

  bool ellipsoid() const { return parts.empty() && exponent_along == 1 && exponent_across == 1; }
  bool round_about_z() const;
  /// The other of two that cross.
  ObjectModel other() const;
  /// In the space where the semi-axes are 1: the point of the surface with outward normal `n` (any
  /// length). Where an edge or a face has that normal, its middle.
  Eigen::Vector3d support(const Eigen::Vector3d& n) const;
  void check() const;  // throws std::invalid_argument naming the parameter
};

ObjectModel ellipsoid(const Eigen::Vector3d& semi_axes);
/// Along z. Flat ends; `half_length` and `radius` in m.
ObjectModel cylinder(double half_length, double radius);
/// Two elliptical plates that share their long axis, z, in the planes of x and z and of y and z:
/// each drawn as a thin ellipsoid. `half_thickness` in m.
ObjectModel crossed_ellipsoids(double half_length, double half_width, double half_thickness);
ObjectModel superquadric(const Eigen::Vector3d& semi_axes, double exponent_along,
                         double exponent_across);
/// Two elliptical plates that share the axis z, in the planes of x and y: flat, or with
/// `rounded` two thin ellipsoids. m; the thickness is the whole of it.
ObjectModel crossed_plates(double half_length, double half_width, double thickness,
                           bool rounded = false);
/// A disc across z with a needle along z, from the disc's lower face up to `needle_length` above
/// its middle. m.
ObjectModel disc_with_needle(double radius, double thickness, double needle_length,
                             double needle_radius);

namespace detail {
/// The convex parts whose outline is in closed form: a body's own, an ellipsoid, a cylinder. Of
/// other superquadrics none.
std::vector<BodyPart> convex_parts(const ObjectModel& body);
}  // namespace detail

}  // namespace vitreo::optics
