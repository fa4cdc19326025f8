// SPDX-License-Identifier: Apache-2.0
#include "control/trajectory.h"

#include "control/preconditions.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace vitreo::control {
namespace {

// Samples of a piece: a spiral of four turns bends by a third of a degree from one to the next.
constexpr std::size_t kSamples = 4096;
// At most this part of the acceleration may go into the bend (its square is 0.9), so that some is
// left to speed up and slow down.
constexpr double kBendPart = 0.95;

}  // namespace

void MotionLimits::check() const {
  require(positive(speed), "speed: must be finite and above 0 m/s");
  require(positive(acceleration), "acceleration: must be finite and above 0 m/s^2");
}

Trajectory Trajectory::hold_at(const Eigen::Vector3d& point) {
  require(point.allFinite(), "point: not finite");
  Trajectory result;
  result.knots_.push_back({point, Eigen::Vector3d::Zero()});
  return result;
}

// Two samples of one speed: Hermite's cubic between them is the straight line.
Trajectory Trajectory::glide(const Eigen::Vector3d& from, const Eigen::Vector3d& velocity,
                             double time) {
  require(velocity.allFinite(), "velocity: not finite");
  require(positive(time), "time: must be finite and above 0 s");
  Trajectory result = hold_at(from);
  const double speed = velocity.norm();
  if (!(speed * time > 0)) return result;
  const Eigen::Vector3d along = velocity / speed;
  result.knots_.front().tangent = along;
  result.knots_.front().speed = speed;
  result.knots_.push_back({from + time * velocity, along, speed * time, speed, time});
  return result;
}

Trajectory Trajectory::line(const Eigen::Vector3d& from, const Eigen::Vector3d& to,
                            const MotionLimits& limits) {
  return waypoints({from, to}, limits);
}

// Four sides and back to the first corner, at rest at each corner.
Trajectory Trajectory::rectangle(const Eigen::Vector3d& corner, const Eigen::Vector3d& side,
                                 const Eigen::Vector3d& up, const MotionLimits& limits) {
  return waypoints({corner, corner + side, corner + side + up, corner + up, corner}, limits);
}

namespace {

// More turns than that are not what the samples of a curve show: a turn has 64 of them.
constexpr double kMostTurns = 64;

void check_turns(double turns) {
  require(std::isfinite(turns) && turns > 0, "turns: must be above 0");
  require(turns <= kMostTurns, "turns: must be at most 64");
}

}  // namespace

// From center + first; towards `second` first, so the sense of turning is that of the two vectors.
Trajectory Trajectory::circle(const Eigen::Vector3d& center, const Eigen::Vector3d& first,
                              const Eigen::Vector3d& second, double turns,
                              const MotionLimits& limits) {
  require(center.allFinite(), "center: not finite");
  require(first.allFinite() && first.norm() > 0, "first: must be a finite radius above 0 m");
  require(second.allFinite() && std::abs(second.norm() - first.norm()) < 1e-6 * first.norm(),
          "second: must be as long as first");
  require(std::abs(first.dot(second)) < 1e-6 * first.squaredNorm(),
          "second: must be at a right angle to first");
  check_turns(turns);
  return curve(
      [&](double t) {
        const double angle = 2 * std::numbers::pi * turns * t;
        return Eigen::Vector3d(center + std::cos(angle) * first + std::sin(angle) * second);
      },
      limits);
}

// Counterclockwise seen from above, at even rise and widening.
Trajectory Trajectory::spiral(const Spiral& shape, const MotionLimits& limits) {
  require(shape.bottom.allFinite(), "bottom: not finite");
  require(std::isfinite(shape.height) && shape.height > 0, "height: must be above 0 m");
  require(std::isfinite(shape.first_radius) && shape.first_radius > 0,
          "first_radius: must be above 0 m");
  require(std::isfinite(shape.last_radius) && shape.last_radius > 0,
          "last_radius: must be above 0 m");
  check_turns(shape.turns);
  return curve(
      [&](double t) {
        const double angle = 2 * std::numbers::pi * shape.turns * t;
        const double radius = shape.first_radius + t * (shape.last_radius - shape.first_radius);
        return Eigen::Vector3d(shape.bottom + Eigen::Vector3d(radius * std::cos(angle),
                                                              radius * std::sin(angle),
                                                              t * shape.height));
      },
      limits);
}

// `position` of 0 to 1; its own speed does not count, as speed follows from the limits alone.
Trajectory Trajectory::curve(const std::function<Eigen::Vector3d(double)>& position,
                             const MotionLimits& limits) {
  Trajectory result;
  result.append(position, limits);
  return result;
}

// At rest at each point. Points that repeat are one; all the same is a hold.
Trajectory Trajectory::waypoints(const std::vector<Eigen::Vector3d>& points,
                                 const MotionLimits& limits) {
  require(!points.empty(), "waypoints: at least one is needed");
  limits.check();
  Trajectory result;
  for (std::size_t k = 0; k < points.size(); ++k) {
    require(points[k].allFinite(), "waypoints: a number is not finite");
    if (k == 0 || points[k] == points[k - 1]) continue;
    const Eigen::Vector3d& from = points[k - 1];
    const Eigen::Vector3d step = points[k] - from;
    result.append([&](double t) { return Eigen::Vector3d(from + t * step); }, limits);
  }
  return result.knots_.empty() ? hold_at(points.front()) : result;
}

// Within a segment the acceleration along the path is constant, so s(t) = v0 t + a t^2 / 2;
// position from s by Hermite's cubic with unit tangents, which is of fourth order in the sampling.
// Before the beginning its first point at rest, after the end its last.
Reference Trajectory::at(double time) const {
  require(!std::isnan(time), "time: not a number");
  if (time < 0) return {knots_.front().position, Eigen::Vector3d::Zero()};
  if (time >= duration()) return {knots_.back().position, Eigen::Vector3d::Zero()};
  const auto next =
      std::upper_bound(knots_.begin(), knots_.end(), time,
                       [](double value, const Knot& knot) { return value < knot.time; });
  const Knot& b = *next;
  const Knot& a = *(next - 1);
  const double span = b.distance - a.distance;
  const double passed = time - a.time;
  const double acceleration = (b.speed - a.speed) / (b.time - a.time);
  const double u = std::clamp((a.speed + acceleration * passed / 2) * passed / span, 0.0, 1.0);
  const double v = 1 - u;
  return {v * v * (1 + 2 * u) * a.position + u * u * (1 + 2 * v) * b.position +
              span * u * v * (v * a.tangent - u * b.tangent),
          (a.speed + acceleration * passed) * (v * a.tangent + u * b.tangent)};
}

// Samples one piece and gives each sample its arc length (as the sum of chords), unit tangent and
// curvature.
// Throws std::invalid_argument for a curve that stands still: it has no tangent there.
void Trajectory::append(const std::function<Eigen::Vector3d(double)>& position,
                        const MotionLimits& limits) {
  limits.check();
  const std::size_t first = knots_.size();
  const double begin = first > 0 ? knots_.back().distance : 0;
  knots_.resize(first + kSamples + 1);
  for (std::size_t k = 0; k <= kSamples; ++k) {
    Knot& knot = knots_[first + k];
    knot.position = position(static_cast<double>(k) / kSamples);
    require(knot.position.allFinite(), "curve: a number is not finite");
    knot.distance = k == 0 ? begin
                           : knots_[first + k - 1].distance +
                                 (knot.position - knots_[first + k - 1].position).norm();
    require(k == 0 || knot.distance > knots_[first + k - 1].distance, "curve: stands still");
  }
  // The parabola through three neighbors at uneven distances h1, h2: d1, d2 are the slopes of its
  // chords, `bend` the second derivative by arc length, whose length is the curvature. At the ends
  // the parabola of the neighbor is extended.
  std::vector<double> curvature(kSamples + 1);
  for (std::size_t k = 0; k <= kSamples; ++k) {
    const std::size_t i = first + std::clamp<std::size_t>(k, 1, kSamples - 1);
    const double h1 = knots_[i].distance - knots_[i - 1].distance;
    const double h2 = knots_[i + 1].distance - knots_[i].distance;
    const Eigen::Vector3d d1 = (knots_[i].position - knots_[i - 1].position) / h1;
    const Eigen::Vector3d d2 = (knots_[i + 1].position - knots_[i].position) / h2;
    const Eigen::Vector3d bend = (d2 - d1) / ((h1 + h2) / 2);
    const Eigen::Vector3d middle = (h2 * d1 + h1 * d2) / (h1 + h2);
    knots_[first + k].tangent =
        (middle + (knots_[first + k].distance - knots_[i].distance) * bend).normalized();
    curvature[k] = bend.norm();
  }
  shape_piece(first, limits, curvature);
}

// Speed along the path in the least time, by a forward and a backward pass in the phase plane (s,
// v^2) (Bobrow, Dubowsky & Gibson 1985): the bend bounds v^2 k <= kBendPart a, and what it leaves,
// sqrt(a^2 - (v^2 k)^2), is the slope d(v^2)/ds / 2 upwards in the first pass and downwards in the
// second. On a straight line this is the trapezoidal profile. At rest at both ends.
// The passes only lower speeds, so the bound of the bend stays kept.
void Trajectory::shape_piece(std::size_t first, const MotionLimits& limits,
                             const std::vector<double>& curvature) {
  const double a = limits.acceleration;
  std::vector<double> square(kSamples + 1);
  for (std::size_t k = 0; k <= kSamples; ++k) {
    square[k] = limits.speed * limits.speed;
    if (curvature[k] > 0) square[k] = std::min(square[k], kBendPart * a / curvature[k]);
  }
  square.front() = square.back() = 0;
  // v^2 at `to` as far as the acceleration along the path allows from `from`; the bend counted at
  // its worse end.
  const auto reach = [&](std::size_t from, std::size_t to) {
    const double bend = std::max(square[from] * curvature[from],
                                 std::min(square[to], square[from]) * curvature[to]);
    const double along = std::sqrt(std::max(a * a - bend * bend, 0.0));
    const double step = std::abs(knots_[first + to].distance - knots_[first + from].distance);
    square[to] = std::min(square[to], square[from] + 2 * along * step);
  };
  for (std::size_t k = 1; k <= kSamples; ++k) reach(k - 1, k);
  for (std::size_t k = kSamples; k > 0; --k) reach(k, k - 1);
  // Constant acceleration over a segment: its mean speed is the mean of the two.
  double time = first > 0 ? knots_[first - 1].time : 0;
  for (std::size_t k = 0; k <= kSamples; ++k) {
    Knot& knot = knots_[first + k];
    knot.speed = std::sqrt(square[k]);
    if (k > 0)
      time += 2 * (knot.distance - knots_[first + k - 1].distance) /
              (knot.speed + knots_[first + k - 1].speed);
    knot.time = time;
  }
  require(std::isfinite(time), "speed: too slow for the path");
}

}  // namespace vitreo::control
