// SPDX-License-Identifier: Apache-2.0
#include "devices/sim/body.h"

#include "devices/sim/checks.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace vitreo::sim {

// Rodrigues' rotation; axis and side are made orthonormal again, against drift over many steps.
void turn_body(BodyState& body, const Eigen::Vector3d& turn) {
  const double angle = turn.norm();
  if (!(angle > 0)) return;
  const Eigen::AngleAxisd rotation(angle, turn / angle);
  body.axis = (rotation * body.axis).normalized();
  const Eigen::Vector3d side = rotation * body.side;
  body.side = (side - side.dot(body.axis) * body.axis).normalized();
}

void BodySettings::check() const {
  const auto wrong = [this](const char* what) {
    throw std::invalid_argument("body '" + name + "': " + what);
  };
  if (!(semi_axis > 0 && semi_axis < 0.1)) wrong("semi_axis must be above zero");
  if (!(semi_radius > 0 && semi_radius < 0.1)) wrong("semi_radius must be above zero");
  if (shape == Shape::disc && semi_axis > semi_radius)
    wrong("a disc's semi_axis (half its thickness) is the smaller");
  if (shape == Shape::rod && semi_axis < semi_radius)
    wrong("a rod's semi_axis (half its length) is the larger");
  if (!position.allFinite()) wrong("position is not finite");
  if (!(axis.allFinite() && axis.norm() > 1e-6)) wrong("axis must be a direction");
  if (!(density > 0 && std::isfinite(density))) wrong("density must be above zero");
  for (const double part : color)
    if (!(part >= 0 && part <= 1)) wrong("color must be within 0 and 1");
  if (!(dot_pitch > 0 && std::isfinite(dot_pitch))) wrong("dot_pitch must be above zero");
}

// Disc: a flat cylinder. Rod: a cylinder of length 2 (a - b) with half a ball at each end.
// Spheroid: 4/3 pi a b^2.
double volume_of(const BodySettings& body) {
  const double a = body.semi_axis;
  const double b = body.semi_radius;
  switch (body.shape) {
    case Shape::disc:
      return 2 * M_PI * a * b * b;  // as of a flat edge; the round one takes little
    case Shape::rod:
      return M_PI * b * b * (2 * (a - b) + 4. / 3 * b);
    case Shape::spheroid:
      break;
  }
  return 4. / 3 * M_PI * a * b * b;
}

// Perrin's drag of a prolate (a > b) or oblate (a < b) spheroid (Perrin 1936; facts/magnetics 3.1):
// the oblate forms are the prolate ones with q^2 = a^2 - b^2 < 0, whose logarithm becomes an arc
// tangent, S = (2/|q|) atan(|q|/a).
SpheroidDrag spheroid_drag(double viscosity, double a, double b) {
  // Both of Perrin's forms are 0/0 at the sphere; within a thousandth of it, Stokes' 6 pi eta b.
  if (std::abs(a / b - 1) < 1e-3) return {6 * M_PI * viscosity * b, 6 * M_PI * viscosity * b};
  const double q2 = a * a - b * b;
  const double q = std::sqrt(std::abs(q2));
  const double s = a > b ? 2 / q * std::log((a + q) / b) : 2 / q * std::atan2(q, a);
  return {16 * M_PI * viscosity * q2 / ((2 * a * a - b * b) * s - 2 * a),
          32 * M_PI * viscosity * q2 / ((2 * a * a - 3 * b * b) * s + 2 * a)};
}

// Support points: of an ellipsoid A A' n / sqrt(n'A A'n); of rod and disc as Minkowski sums of a
// ball with a segment and with a flat disc.
// `direction` is a unit vector. Ends of a rod and rim of a disc are round with the smaller
// semi-axis.
Eigen::Vector3d support(Shape shape, const BodyState& body, const Eigen::Vector3d& direction) {
  const double along = body.axis.dot(direction);
  const double a = body.semi_axis;
  const double b = body.semi_radius;
  if (shape == Shape::rod) return b * direction + (along < 0 ? b - a : a - b) * body.axis;
  const Eigen::Vector3d across = direction - along * body.axis;
  if (shape == Shape::disc) {
    const double length = across.norm();
    return a * direction + (length > 1e-12 ? (b - a) / length : 0) * across;
  }
  const Eigen::Vector3d squared = a * a * along * body.axis + b * b * across;
  return squared / std::sqrt(std::max(direction.dot(squared), 1e-300));
}

// Penetration depth of two convex bodies: the least of -u.gap over all directions u, gap being the
// vector between the support points that face each other (the separating-axis theorem; Ericson
// 2005, chapter 5).
Overlap overlap(Shape first_shape, const BodyState& first, Shape second_shape,
                const BodyState& second) {
  const Eigen::Vector3d between = second.position - first.position;
  const double reach =
      std::max(first.semi_axis, first.semi_radius) + std::max(second.semi_axis, second.semi_radius);
  const double distance = between.norm();
  if (distance >= reach || !(distance > 0)) return {};
  // Beyond both bounding balls there is no overlap. Within, the largest of
  //   u.between - h1(u) - h2(-u)
  // over the sphere of directions, h the support functions: by steps along its gradient, which is
  // the gap itself (a support function's gradient is its support point), projected across u. The
  // steps shrink, so that 24 end near the maximum; any positive value proves the bodies apart.
  Overlap best{between / distance, reach};
  Eigen::Vector3d u = best.normal;
  double stride = 1;
  for (int pass = 0; pass < 24; ++pass, stride *= 0.8) {
    const Eigen::Vector3d gap =
        between - support(first_shape, first, u) + support(second_shape, second, -u);
    const double depth = -u.dot(gap);
    if (depth < best.depth) best = {u, depth};
    if (depth <= 0) return {};
    const Eigen::Vector3d slope = gap + depth * u;  // what of the gap lies across u
    if (slope.norm() < 1e-9 * reach) break;
    u = (u + stride * slope / reach).normalized();
  }
  return best;
}

void Cavity::check() const {
  require(vertex.allFinite(), "eye_in_world is not finite");
  require_positive(radius, "retina_radius");
  require_positive(lens_depth, "lens_depth");
}

// Below the equator a sphere of the retina's radius about the center; the distance is negative
// outside.
Cavity::Wall Cavity::retina(const Eigen::Vector3d& point) const {
  Eigen::Vector3d from_center = point - vertex - Eigen::Vector3d(0, 0, radius);
  // Above the equator the wall is a cylinder.
  if (from_center.z() > 0) from_center.z() = 0;
  const double distance = from_center.norm();
  // In the middle every direction is as good.
  if (!(distance > 0)) return {Eigen::Vector3d::UnitZ(), radius};
  return {-from_center / distance, radius - distance};
}

// Contact as a projection: the body is moved back by the depth along the wall's normal. The depth
// is what the normal force had pressed it in, so Coulomb's friction |F_t| <= mu F_n takes at most
// mu * depth from the sliding of the point of contact, u + w x r.
bool keep_inside(const Cavity& cavity, Shape shape, double friction, const Eigen::Vector3d& before,
                 const Eigen::Vector3d& turned, BodyState& body) {
  const auto push_back = [&](const Eigen::Vector3d& outward, const Eigen::Vector3d& touching,
                             double depth) {
    body.position -= depth * outward;
    const Eigen::Vector3d moved = body.position - before + turned.cross(touching);
    const Eigen::Vector3d sliding = moved - moved.dot(outward) * outward;
    const double slid = sliding.norm();
    const double held = friction * depth;
    if (slid > 0) body.position -= sliding * std::min(1.0, held / slid);
  };
  bool touches = false;
  Cavity::Wall wall = cavity.retina(body.position);
  if (wall.distance < std::max(body.semi_axis, body.semi_radius)) {
    // The point that reaches farthest out: along the wall's normal there, which the point's own
    // position decides; a fixed-point iteration.
    Eigen::Vector3d farthest = support(shape, body, -wall.normal);
    for (int pass = 0; pass < 3; ++pass) {
      wall = cavity.retina(body.position + farthest);
      farthest = support(shape, body, -wall.normal);
    }
    wall = cavity.retina(body.position + farthest);
    touches = wall.distance < 0;
    if (touches) push_back(-wall.normal, farthest, -wall.distance);
  }
  const Eigen::Vector3d top = support(shape, body, Eigen::Vector3d::UnitZ());
  const double above = -cavity.below_lens(body.position + top);
  if (above > 0) push_back(Eigen::Vector3d::UnitZ(), top, above);
  return touches;
}

}  // namespace vitreo::sim
