// SPDX-License-Identifier: Apache-2.0
#include "optics/pose/object_model.h"

#include "optics/numerics/preconditions.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

namespace vitreo::optics {
namespace {

/// base^exponent for the two exponents that ellipsoids, cylinders and boxes have, without std::pow.
double power(double base, double exponent) {
  if (exponent == 1) return base;
  if (exponent == 0) return 1;
  return std::pow(base, exponent);
}

/// 0 of 0: a normal in a plane of symmetry has its point of contact in that plane.
double sign(double x) { return x > 0 ? 1 : x < 0 ? -1 : 0; }

/// (x^q + y^q)^(1/q) of numbers that are not negative, scaled against overflow.
/// Scaling by the larger one keeps its q-th power from overflowing, as q grows without bound
/// towards exponent 2.
double norm(double x, double y, double q) {
  if (q == 2) return std::sqrt(x * x + y * y);
  if (q == 1) return x + y;
  const double larger = std::fmax(x, y);
  return larger > 0 ? larger * std::pow(1 + std::pow(std::fmin(x, y) / larger, q), 1 / q) : 0;
}

}  // namespace

/// The gradient of the support function h(n) = max n . p. The body is the unit ball of nested
/// p-norms with exponents 2 / e, so h is the dual norm, whose exponent is q = 2 / (2 - e) from 1/p
/// + 1/q = 1, and the gradient's components are powers (n_i / |n|)^(q - 1).
/// Points of contact of the body with semi-axes 1; the caller scales. A zero normal gives the
/// center.
Eigen::Vector3d ObjectModel::support(const Eigen::Vector3d& n) const {
  const double across = 2 / (2 - exponent_across);
  const double along = 2 / (2 - exponent_along);
  const Eigen::Vector3d size = n.cwiseAbs();
  const double section = norm(size.x(), size.y(), across);
  const double whole = norm(section, size.z(), along);
  Eigen::Vector3d point(0, 0, 0);
  if (!(whole > 0)) return point;
  point.z() = power(size.z() / whole, along - 1) * sign(n.z());
  if (!(section > 0)) return point;
  const double out = power(section / whole, along - 1);
  point.x() = out * power(size.x() / section, across - 1) * sign(n.x());
  point.y() = out * power(size.y() / section, across - 1) * sign(n.y());
  return point;
}

/// Of the parts those count that are balls or cylinders along z on the axis.
bool ObjectModel::round_about_z() const {
  if (parts.empty()) return exponent_across == 1 && semi_axes.x() == semi_axes.y();
  return std::all_of(parts.begin(), parts.end(), [](const BodyPart& part) {
    return part.semi_axes.x() == part.semi_axes.y() && part.center.head<2>().isZero(0) &&
           std::abs(part.orientation(2, 2)) == 1;
  });
}

/// The origin must lie in each part: the outline is star-shaped about its image only then.
void ObjectModel::check() const {
  for (const BodyPart& part : parts) {
    part.check();
    const Eigen::Vector3d origin =
        (part.orientation.transpose() * -part.center).cwiseQuotient(part.semi_axes);
    const bool ball = part.kind == BodyPart::Kind::ball;
    const double out =
        ball ? origin.norm() : std::max(origin.head<2>().norm(), std::abs(origin.z()));
    detail::require(out < 1, "parts: each must hold the origin");
  }
  if (!parts.empty()) return;
  detail::require(semi_axes.allFinite() && semi_axes.minCoeff() > 0, "semi_axes: must be positive");
  // towards 2 the body becomes an octahedron, whose points have no normal
  constexpr double kSharpest = 1.9;
  const auto exponent = [](const char* name, double value) {
    if (!(value >= 0 && value <= kSharpest)) {
      throw std::invalid_argument(std::string(name) + ": must lie between 0 and 1.9");
    }
  };
  exponent("exponent_along", exponent_along);
  exponent("exponent_across", exponent_across);
  detail::require(!crossed || ellipsoid(), "crossed: must be an ellipsoid");
}

ObjectModel ObjectModel::other() const {
  ObjectModel turned = *this;
  turned.semi_axes = {semi_axes.y(), semi_axes.x(), semi_axes.z()};
  return turned;
}

ObjectModel ellipsoid(const Eigen::Vector3d& semi_axes) { return {semi_axes, 1, 1, false}; }

/// A superquadric whose exponent along the axis is 0 has flat ends; 1 across makes the section a
/// circle.
ObjectModel cylinder(double half_length, double radius) {
  return {{radius, radius, half_length}, 0, 1, false};
}

ObjectModel crossed_ellipsoids(double half_length, double half_width, double half_thickness) {
  return {{half_thickness, half_width, half_length}, 1, 1, true};
}

ObjectModel superquadric(const Eigen::Vector3d& semi_axes, double exponent_along,
                         double exponent_across) {
  return {semi_axes, exponent_along, exponent_across, false};
}

/// An elliptical plate is a cylinder along its own normal.
ObjectModel crossed_plates(double half_length, double half_width, double thickness, bool rounded) {
  const auto kind = rounded ? BodyPart::Kind::ball : BodyPart::Kind::cylinder;
  // The plate's normal is its z; its x lies along the body's axis.
  Eigen::Matrix3d in_x_plane;
  in_x_plane << 0, 1, 0, 0, 0, 1, 1, 0, 0;
  Eigen::Matrix3d in_y_plane;
  in_y_plane << 0, 0, -1, 0, 1, 0, 1, 0, 0;
  const Eigen::Vector3d size(half_length, half_width, thickness / 2);
  ObjectModel body;
  body.parts = {{kind, size, {0, 0, 0}, in_x_plane}, {kind, size, {0, 0, 0}, in_y_plane}};
  return body;
}

ObjectModel disc_with_needle(double radius, double thickness, double needle_length,
                             double needle_radius) {
  const double low = -thickness / 2;
  ObjectModel body;
  body.parts = {{BodyPart::Kind::cylinder, {radius, radius, thickness / 2}},
                {BodyPart::Kind::cylinder,
                 {needle_radius, needle_radius, (needle_length - low) / 2},
                 {0, 0, (needle_length + low) / 2}}};
  return body;
}

std::vector<BodyPart> detail::convex_parts(const ObjectModel& body) {
  if (!body.parts.empty()) return body.parts;
  if (body.crossed)
    return {{BodyPart::Kind::ball, body.semi_axes}, {BodyPart::Kind::ball, body.other().semi_axes}};
  if (body.ellipsoid()) return {{BodyPart::Kind::ball, body.semi_axes}};
  if (body.exponent_along == 0 && body.exponent_across == 1)
    return {{BodyPart::Kind::cylinder, body.semi_axes}};
  return {};
}

}  // namespace vitreo::optics
