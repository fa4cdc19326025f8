// SPDX-License-Identifier: Apache-2.0
#include "optics/pose/body_part.h"

#include "optics/numerics/preconditions.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>

namespace vitreo::optics {

void BodyPart::check() const {
  detail::require(semi_axes.allFinite() && semi_axes.minCoeff() > 0,
                  "parts: semi_axes must be positive");
  detail::require(center.allFinite(), "parts: center must be finite");
  const bool rotation = orientation.allFinite() &&
                        (orientation.transpose() * orientation).isIdentity(1e-9) &&
                        orientation.determinant() > 0;
  detail::require(rotation, "parts: orientation must be a rotation");
}

namespace detail {
namespace {

using Vector = Eigen::Vector3d;

/// Of the unit ball or the unit cylinder: gauge, point of contact before it grew, and the covector
/// of the tangent plane there (its product with the point is the support, 1 for the ball).
struct UnitTouch {
  double gauge = 0;
  Vector point{0, 0, 0};
  Vector covector{0, 0, 1};
};

/// The nearest point of the line has the gauge as its length.
UnitTouch touch_ball(const Vector& o, const Vector& d) {
  UnitTouch touch;
  const Vector nearest = o - d * (o.dot(d) / d.squaredNorm());
  touch.gauge = nearest.norm();
  // A line through the middle touches the vanished ball everywhere; any normal across it does.
  touch.covector = touch.gauge > 0 ? Vector(nearest / touch.gauge) : d.unitOrthogonal();
  touch.point = touch.covector;
  return touch;
}

/// The frame in which a cylinder's shadow along a line is simple: x along the shadow of its axis, y
/// across both, so that y is horizontal in the cylinder's frame.
struct ShadowFrame {
  Vector x;
  Vector y;
  Vector level;  // unit, horizontal: the direction of the cap's rim that x shows
  double sine;   // of the angle between axis and line: half the length of the axis' shadow
  double cosine;
  explicit ShadowFrame(const Vector& d) : sine(std::hypot(d.x(), d.y())), cosine(std::abs(d.z())) {
    constexpr double kAlong = 1e-12;  // seen end on the shadow is a disc, and x any direction
    if (sine < kAlong) {
      sine = 0;
      level = Vector::UnitX();
      x = level;
    } else {
      level = Vector(d.x(), d.y(), 0) * ((d.z() > 0 ? -1 : 1) / sine);
      x = (Vector::UnitZ() - d.z() * d) / sine;
    }
    y = d.cross(x);
  }
};

/// The unit cylinder's shadow is the Minkowski sum of a segment of half length s (its axis) and an
/// ellipse with semi-axes c along it and 1 across (its caps), s and c the sine and cosine of the
/// angle between axis and line. Beside the segment (|x| <= |y| s) the shadow is bounded by its
/// straight sides, and the gauge is |y|. Beyond, g solves ((|x| / g - s) / c)^2 + (y / g)^2 = 1:
///   1 / g = (|x| s + c sqrt(x^2 + y^2 (c^2 - s^2))) / (x^2 + c^2 y^2).
UnitTouch touch_cylinder(const Vector& o, const Vector& direction) {
  const ShadowFrame frame(direction.normalized());
  const double x = frame.x.dot(o);
  const double y = frame.y.dot(o);
  const double s = frame.sine;
  const double c = frame.cosine;
  UnitTouch touch;
  if (std::abs(x) < std::abs(y) * s) {
    touch.gauge = std::abs(y);
    touch.covector = y < 0 ? Vector(-frame.y) : frame.y;
    // Where on the generator: its shadow is x / g.
    touch.point = touch.covector + Vector::UnitZ() * (x / (touch.gauge * s));
    return touch;
  }
  const double root = std::sqrt(std::max(x * x + y * y * (c * c - s * s), 0.0));
  const double per = std::abs(x) * s + c * root;
  touch.gauge = per > 0 ? (x * x + c * c * y * y) / per : 0;
  const double end = x < 0 ? -1 : 1;
  const double across = touch.gauge > 0 ? std::clamp(y / touch.gauge, -1.0, 1.0) : 0;
  const double out = std::sqrt(1 - across * across);
  touch.point = end * out * frame.level + across * frame.y + end * Vector::UnitZ();
  // The normal of the cap's ellipse, (out / c, across) up to a factor, times c: finite where the
  // cap is seen edge on.
  touch.covector = end * out * frame.x + c * across * frame.y;
  if (!(touch.covector.squaredNorm() > 0)) touch.covector = frame.y * across;
  return touch;
}

}  // namespace

/// In the space where the part is the unit ball or cylinder: tangency is preserved by affine maps.
Tangency touch(const BodyPart& part, const Eigen::Vector3d& origin,
               const Eigen::Vector3d& direction) {
  const Vector o =
      (part.orientation.transpose() * (origin - part.center)).cwiseQuotient(part.semi_axes);
  const Vector d = (part.orientation.transpose() * direction).cwiseQuotient(part.semi_axes);
  const UnitTouch unit =
      part.kind == BodyPart::Kind::ball ? touch_ball(o, d) : touch_cylinder(o, d);
  Tangency made;
  made.gauge = unit.gauge;
  const Vector normal = part.orientation * unit.covector.cwiseQuotient(part.semi_axes);
  const Vector arm = part.orientation * unit.point.cwiseProduct(part.semi_axes);
  made.normal = normal.normalized();
  made.support = made.normal.dot(arm);
  made.point = part.center + made.gauge * arm;
  return made;
}

}  // namespace detail
}  // namespace vitreo::optics
