// Wide-angle map of a chain without rotational symmetry, in two field angles and the depth.
// SPDX-License-Identifier: Apache-2.0
#include "optics/maps/wide_angle_map.h"

#include <Eigen/Dense>

#include <algorithm>
#include <cmath>
#include <limits>

namespace vitreo::optics {
namespace {

using detail::SkewTable;

constexpr double kSlack = 1e-9;  // m: a point computed to lie on the table's edge is on it
constexpr double kTurn = 2 * std::numbers::pi;

/// From the unit cube of the cells (radius, azimuth over a turn, depth) to the table's (xi, eta,
/// v).
Eigen::Vector3d position_of_unit(const Eigen::Vector3d& unit) {
  return {unit.x() * std::cos(kTurn * unit.y()), unit.x() * std::sin(kTurn * unit.y()),
          2 * unit.z() - 1};
}

/// The azimuth of -pi to pi becomes a turn from 0 to 1, as the cells count it.
Eigen::Vector3d unit_of_position(const Eigen::Vector3d& position) {
  const double turn = std::atan2(position.y(), position.x()) / kTurn;
  return {position.head<2>().norm(), turn < 0 ? turn + 1 : turn, (position.z() + 1) / 2};
}

}  // namespace

/// (xi, eta) is the field angle over its maximum with its azimuth; v the depth, from -1 at the
/// retina to 1.
/// The center of the stop is the origin of the polar coordinates here too, so `distance` is shared
/// with the symmetric map.
Eigen::Vector3d WideAngleMap::skew_point(const Eigen::Vector3d& position) const {
  const double rho = position.head<2>().norm();
  const double angle = rho * max_angle_;
  const double left = distance(angle) - max_depth() * (position.z() + 1) / 2;
  const double r = left * std::sin(angle);
  const Eigen::Vector2d across =
      rho > 0 ? Eigen::Vector2d(position.head<2>() * (r / rho)) : Eigen::Vector2d(0, 0);
  return {across.x(), across.y(), stop_z_ - left * std::cos(angle)};
}

/// Inverse of skew_point; nothing outside the table.
/// kSlack lets points in that rounding has put beyond the edge.
std::optional<Eigen::Vector3d> WideAngleMap::skew_position(const Eigen::Vector3d& point) const {
  if (!(point.z() < stop_z_)) return std::nullopt;
  const double r = point.head<2>().norm();
  const double left = std::hypot(r, stop_z_ - point.z());
  const double angle = std::atan2(r, stop_z_ - point.z());
  if (!(angle <= max_angle_ + kSlack / left)) return std::nullopt;
  const double inside = std::min(angle, max_angle_);
  const double depth = distance(inside) - left;
  if (!(depth >= -kSlack && depth <= max_depth() + kSlack)) return std::nullopt;
  const Eigen::Vector2d across =
      r > 0 ? Eigen::Vector2d(point.head<2>() / r) : Eigen::Vector2d(0, 0);
  const double rho = inside / max_angle_;
  return Eigen::Vector3d(across.x() * rho, across.y() * rho,
                         std::clamp(2 * depth / max_depth() - 1, -1.0, 1.0));
}

/// The table's largest error against traced bundles between its nodes, where it is worst: by the
/// rim and by both ends of depth; m. What is deep in the iris' shadow does not count.
/// At azimuths between the arms, where trigonometric interpolation is worst. Infinite where a
/// bundle is lost.
double WideAngleMap::skew_error() const {
  constexpr double kRadii[] = {0.3, 0.7, 0.9, 0.97, 0.995};
  constexpr double kDepths[] = {-0.98, -0.6, 0.05, 0.7, 0.985};
  constexpr double kShadow = 1.2;  // of the stop's radius
  PupilTracer tracer = tracer_;
  Spot spot;
  double worst = 0;
  for (int i = 0; i < 5 * SkewTable::kArms; ++i) {
    const int arm = i / 5;
    const double azimuth = kTurn * (arm + 0.5) / SkewTable::kArms;
    const Eigen::Vector2d field =
        kRadii[i % 5] * Eigen::Vector2d(std::cos(azimuth), std::sin(azimuth));
    const Eigen::Vector3d position(field.x(), field.y(), kDepths[(i + i / 5) % 5]);
    const auto aerial = focus_bundle(skew_point(position), tracer, spot);
    if (!aerial) return std::numeric_limits<double>::infinity();
    if (spot.chief_stop.norm() > kShadow * stop_radius_) continue;
    const Eigen::Vector3d image(aerial->m.x(), aerial->m.y(), aerial->focus);
    worst = std::max(worst, (skew_(position).value - image).norm());
  }
  return worst;
}

/// As build_flat, over rings, arms and depths. The table's error is measured, not taken from its
/// last coefficients.
/// A polynomial of two angles may look converged in its last coefficients and still be off between
/// the arms.
bool WideAngleMap::build_skew() {
  const int rings = angle_nodes_;
  const int depths = depth_nodes_;
  Eigen::MatrixXd samples(rings * SkewTable::kArms * depths, SkewTable::kValues);
  Spot spot;
  Eigen::Index row = 0;
  for (int ring = 0; ring < rings; ++ring) {
    for (int arm = 0; arm < SkewTable::kArms; ++arm) {
      const Eigen::Vector2d field = SkewTable::sample_position(ring, rings, arm);
      for (int k = 0; k < depths; ++k) {
        const Eigen::Vector3d position(field.x(), field.y(), detail::Chebyshev2::node(k, depths));
        const auto aerial = focus_bundle(skew_point(position), tracer_, spot);
        if (!aerial) return false;
        samples.row(row++) << aerial->m.x(), aerial->m.y(), aerial->focus, spot.chief_stop.x(),
            spot.chief_stop.y();
      }
    }
  }
  constexpr double kMaxTail = 0.5e-6;  // m
  skew_ = SkewTable(samples, rings, depths);
  tail_ = skew_error();
  if (!(tail_ < kMaxTail)) return false;
  const auto sampled = [&](const SkewSearch::Point& unit) {
    return skew_sample(position_of_unit(unit));
  };
  skew_search_ = SkewSearch({8, 16, 8}, sampled);
  const auto newton = [&](const SkewSearch::Point& image) {
    return [&, image](const SkewSearch::Point& start) { return solve(image, start); };
  };
  skew_search_.test_one_to_one(newton, sampled);
  return true;
}

/// The image is (mx, my, d_ls), in m; hidden when the chief ray misses the eye's stop.
WideAngleMap::SkewSearch::Sample WideAngleMap::skew_sample(const Eigen::Vector3d& position) const {
  const SkewTable::Image there = skew_(position);
  return {there.value, there.per_position.determinant(),
          skew_.stop(position).norm() > stop_radius_};
}

/// Newton's method in (xi, eta, v), kept near the table; these are regular on the axis, as angle
/// and azimuth are not.
/// Positions outside by less than edge() are put onto the boundary, as in the symmetric map.
std::optional<WideAngleMap::SkewSearch::Solution> WideAngleMap::solve(
    const SkewSearch::Point& image, const SkewSearch::Point& start) const {
  constexpr int kMaxSteps = 30;
  constexpr double kConverged = 1e-12;  // m, of an image
  constexpr double kStray = 0.05;  // of the table's sides: how far the method may stray on its way
  Eigen::Vector3d position = position_of_unit(start);
  for (int step = 0; step < kMaxSteps; ++step) {
    const SkewTable::Image now = skew_(position);
    const Eigen::Vector3d off = image - now.value;
    const double rho = position.head<2>().norm();
    if (off.norm() < kConverged) {
      const double aside = edge() / (distance(0) * max_angle_);
      const double along = 2 * edge() / max_depth();
      if (!(rho <= 1 + aside && std::abs(position.z()) <= 1 + along)) return std::nullopt;
      if (rho > 1) position.head<2>() /= rho;
      position.z() = std::clamp(position.z(), -1.0, 1.0);
      return SkewSearch::Solution{unit_of_position(position), position, skew_sample(position)};
    }
    const Eigen::Vector3d move = now.per_position.inverse() * off;
    if (!move.allFinite()) return std::nullopt;
    position += move;
    // Drawn back as a vector, so that the azimuth is kept.
    const double strayed = position.head<2>().norm() / (1 + kStray);
    if (strayed > 1) position.head<2>() /= strayed;
    position.z() = std::clamp(position.z(), -1 - 2 * kStray, 1 + 2 * kStray);
  }
  return std::nullopt;
}

/// As image(): where the table is not one-to-one, the inverse must lead back.
std::optional<AerialPoint> WideAngleMap::skew_image(const Eigen::Vector3d& point) const {
  const auto position = skew_position(point);
  if (!position) return std::nullopt;
  const SkewSearch::Sample there = skew_sample(*position);
  if (there.hidden) return std::nullopt;
  const AerialPoint aerial{there.image.head<2>(), there.image.z()};
  if (!skew_search_.one_to_one() && !this->point(aerial)) return std::nullopt;
  return aerial;
}

}  // namespace vitreo::optics
