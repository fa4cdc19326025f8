// SPDX-License-Identifier: Apache-2.0
#include "control/clearance.h"

#include "control/preconditions.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

namespace vitreo::control {
namespace {

constexpr double kCoverage = 2.58;  // of 99 % of a normal distribution
// Of 99.5 % of the tilts, which have two directions: sqrt(-2 ln 0.005).
constexpr double kTilted = 3.26;
constexpr double kMeanTilt = 0.38;  // the mean tilt, sqrt(pi / 2), over that one
constexpr double kFlat = 1e-9;      // m or a cosine: below, a direction has no meaning

// The body's point that reaches farthest along `direction` (unit), from its center. Of a flat end,
// which reaches as far everywhere, the point of its rim towards `rim` (across the axis, unit).
Eigen::Vector3d farthest(const BodySurface& body, const Eigen::Vector3d& axis,
                         const Eigen::Vector3d& direction, const Eigen::Vector3d& rim) {
  const double along = axis.dot(direction);
  const Eigen::Vector3d across = direction - along * axis;
  const double a = body.semi_axis;
  const double b = body.semi_radius;
  if (body.shape == BodyShape::cylinder || body.shape == BodyShape::disc) {
    const double length = across.norm();
    return std::copysign(a, along) * axis + b * (length > kFlat ? (across / length).eval() : rim);
  }
  // A A' n / |A' n| with the semi-axes in A.
  const Eigen::Vector3d squared = a * a * along * axis + b * b * across;
  return squared / std::sqrt(std::max(direction.dot(squared), kFlat * kFlat));
}

/// From the retina's center, or above the equator from the eye's axis.
Eigen::Vector3d from_center(const EyeCavity& eye, const Eigen::Vector3d& point) {
  // The center is one radius above the vertex; z is up, so the sphere is below the equator and only
  // what lies below it counts along z.
  Eigen::Vector3d away = point - eye.vertex - Eigen::Vector3d(0, 0, eye.radius);
  away.z() = std::min(away.z(), 0.0);
  return away;
}

/// A unit vector across `axis`, of `towards` what lies across it.
Eigen::Vector3d across_of(const Eigen::Vector3d& axis, const Eigen::Vector3d& towards) {
  const Eigen::Vector3d across = towards - axis.dot(towards) * axis;
  if (across.norm() > kFlat) return across.normalized();
  return axis.unitOrthogonal();
}

struct Reached {
  double distance;          // m, from the retina's center
  Eigen::Vector3d outward;  // unit, there
};

// The distance from the center is a convex function, whose maximum over a convex body is found by
// going to the support point along its gradient again and again: each step climbs. Started from the
// wall's direction and both ends of the axis, as a long body near the center has several maxima,
// and of a body with flat ends from its sides, too.
Reached reached(const BodySurface& body, const EyeCavity& eye, const Eigen::Vector3d& position,
                const Eigen::Vector3d& axis) {
  constexpr int kSteps = 40;
  constexpr double kSettled = 1e-10;  // m
  const Eigen::Vector3d center = from_center(eye, position);
  const Eigen::Vector3d rim = across_of(axis, center);
  const Eigen::Vector3d third = axis.cross(rim);
  const Eigen::Vector3d wall =
      center.norm() > kFlat ? center.normalized() : Eigen::Vector3d(0, 0, -1);
  Reached best{-1, wall};
  const std::array<Eigen::Vector3d, 7> starts{wall, axis, -axis, rim, -rim, third, -third};
  const bool edged = body.shape == BodyShape::cylinder || body.shape == BodyShape::disc;
  for (std::size_t k = 0; k < (edged ? starts.size() : 3); ++k) {
    const Eigen::Vector3d& start = starts[k];
    Reached now{-1, start};
    for (int step = 0; step < kSteps; ++step) {
      const Eigen::Vector3d away =
          from_center(eye, position + farthest(body, axis, now.outward, rim));
      const double distance = away.norm();
      const bool settled = distance - now.distance < kSettled;
      now.distance = std::max(distance, now.distance);
      if (distance > kFlat) now.outward = away / distance;
      if (settled) break;
    }
    if (now.distance > best.distance) best = now;
  }
  return best;
}

/// The attitudes within `off` (rad) of the axis at which the body can reach farthest along a
/// normal: the nearest to it, the farthest from it, and of a body with an edge the one with the
/// edge ahead.
std::array<Eigen::Vector3d, 3> worst_attitudes(const BodySurface& body, const Eigen::Vector3d& axis,
                                               const Eigen::Vector3d& normal, double off) {
  const Eigen::Vector3d end = axis.dot(normal) < 0 ? Eigen::Vector3d(-axis) : axis;
  // The body is the same at both ends, so the angle is within a right one.
  const double angle = std::acos(std::min(1.0, end.dot(normal)));
  const double least = std::isfinite(off) ? std::max(0.0, angle - off) : 0;
  const double most = std::isfinite(off) ? std::min(M_PI / 2, angle + off) : M_PI / 2;
  const double edge = std::clamp(std::atan2(body.semi_radius, body.semi_axis), least, most);
  const Eigen::Vector3d side = across_of(normal, end);
  const auto turned = [&](double to) -> Eigen::Vector3d {
    return std::cos(to) * normal + std::sin(to) * side;
  };
  return {turned(least), turned(most), turned(edge)};
}

double from_lens(const BodySurface& body, const EyeCavity& eye, const UncertainPose& pose,
                 const Eigen::Vector3d& axis) {
  return eye.vertex.z() + eye.lens_depth - pose.position.z() - body.reach(axis.z());
}

/// Along the normal, where the retina is nearest: its depth, and its sag, which grows with the
/// square of the distance from the axis.
double retina_spread(const EyeCavity& eye, const Eigen::Vector3d& normal) {
  constexpr double kStated = 4e-3;  // m from the axis
  const double aside = eye.radius * normal.head<2>().norm() / kStated;
  return std::abs(normal.z()) * std::hypot(eye.retina_sigma, eye.sag_sigma * aside * aside);
}

/// Sets the 99 % half width (clearance()). `own`: sigma of the wall's place along its normal, m.
/// `distance_of`: with another axis.
template <class Distance>
void set_uncertainty(const BodySurface& body, const UncertainPose& pose, double own,
                     WallClearance& wall, const Distance& distance_of) {
  const double placed = std::max(0.0, wall.normal.dot(pose.covariance * wall.normal));
  const double spread = std::hypot(std::sqrt(placed), own);
  double least = wall.distance;
  if (pose.axis_sigma > 0)
    for (const Eigen::Vector3d& axis :
         worst_attitudes(body, pose.axis, wall.normal, kTilted * pose.axis_sigma))
      least = std::min(least, distance_of(axis));
  // A tilt only takes distance: about its mean, the rest adds to the position's in quadrature.
  // 0.38 d + hypot(2.58 spread, 0.62 d): docs/control.md, "Clearance and margin".
  const double nearer = wall.distance - least;
  wall.uncertainty = kMeanTilt * nearer + std::hypot(kCoverage * spread, (1 - kMeanTilt) * nearer);
}

}  // namespace

void BodySurface::check() const {
  require(positive(semi_axis), "body semi_axis: must be above 0 m");
  require(positive(semi_radius), "body semi_radius: must be above 0 m");
}

// Of an ellipsoid sqrt(a^2 c^2 + b^2 s^2), of a cylinder a c + b s.
double BodySurface::reach(double cosine) const {
  const double c = std::min(1.0, std::abs(cosine));
  const double s = std::sqrt(1 - c * c);
  if (shape == BodyShape::cylinder || shape == BodyShape::disc)
    return semi_axis * c + semi_radius * s;
  return std::hypot(semi_axis * c, semi_radius * s);
}

BodySurface surface_of(const Robot& robot) {
  return {robot.shape, robot.semi_axis, robot.semi_radius};
}

void EyeCavity::check() const {
  require(vertex.allFinite(), "eye vertex: must be finite");
  require(positive(radius), "eye radius: must be above 0 m");
  require(positive(lens_depth), "eye lens_depth: must be above 0 m");
  require(not_negative(retina_sigma), "eye retina_sigma: must be at least 0 m");
  require(not_negative(sag_sigma), "eye sag_sigma: must be at least 0 m");
  require(not_negative(lens_sigma), "eye lens_sigma: must be at least 0 m");
}

Clearance clearance(const BodySurface& body, const EyeCavity& eye, const UncertainPose& pose) {
  body.check();
  eye.check();
  require(pose.position.allFinite() && pose.covariance.allFinite(),
          "clearance: position and covariance must be finite");
  require(std::abs(pose.axis.norm() - 1) < 1e-6, "clearance: the axis must be a unit vector");
  require(pose.axis_sigma >= 0, "clearance: axis_sigma must be at least 0 rad");
  const auto from_retina = [&](const Eigen::Vector3d& axis) {
    return eye.radius - reached(body, eye, pose.position, axis).distance;
  };
  Clearance found;
  const Reached far = reached(body, eye, pose.position, pose.axis);
  found.retina.distance = eye.radius - far.distance;
  found.retina.normal = -far.outward;
  set_uncertainty(body, pose, retina_spread(eye, found.retina.normal), found.retina, from_retina);
  found.lens.normal = -Eigen::Vector3d::UnitZ();
  found.lens.distance = from_lens(body, eye, pose, pose.axis);
  set_uncertainty(body, pose, eye.lens_sigma, found.lens,
                  [&](const Eigen::Vector3d& axis) { return from_lens(body, eye, pose, axis); });
  return found;
}

}  // namespace vitreo::control
