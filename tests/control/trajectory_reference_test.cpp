// Trajectory against closed forms of paths and of motion in least time.
// SPDX-License-Identifier: Apache-2.0
#include "control/trajectory.h"

#include <Eigen/Dense>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>
#include <vector>

namespace vitreo::control {
namespace VITREO_TEST_FILE {

using Eigen::Vector3d;
constexpr double kPi = std::numbers::pi;

/// m along a straight line of `length`, from rest to rest in least time, and the whole time.
struct Straight {
  double length, speed, acceleration;
  double top() const { return std::min(speed, std::sqrt(length * acceleration)); }
  double time() const { return length / top() + top() / acceleration; }
  double at(double t) const {
    const double ramp = top() / acceleration;
    const auto from_rest = [&](double span) {
      return span < ramp ? acceleration * span * span / 2 : top() * (span - ramp / 2);
    };
    if (t < time() / 2) return from_rest(std::max(t, 0.0));
    return length - from_rest(std::max(time() - t, 0.0));
  }
};

/// Of the acceleration, what a bend alone takes at most. The docs' words say all of it.
constexpr double kBend = 0.95;

/// On a circle both accelerations make A: with q = v^2, dq/ds = 2 sqrt(A^2 - (q / r)^2), so
/// q = r A sin(2 s / r) from rest, until q is speed^2 or `bend` r A.
struct Round {
  double radius, angle, speed, acceleration;  // m, rad, m/s, m/s^2
  double bend = kBend;
  double top() const { return std::min(speed, std::sqrt(bend * radius * acceleration)); }
  /// rad in which the top speed, or the middle, is reached.
  double ramp() const {
    return std::min(angle, std::asin(top() * top() / (radius * acceleration))) / 2;
  }
  /// s from rest to `turned` rad, at most ramp(): the integral of r dth / sqrt(r A sin 2 th), by
  /// th = w^2, which makes it smooth.
  double time_to(double turned) const {
    const int n = 200;
    const double h = std::sqrt(turned) / n;
    double sum = 0;
    for (int k = 0; k < n; ++k) {
      const double w = (k + 0.5) * h;
      sum += 2 * w / std::sqrt(std::sin(2 * w * w));
    }
    return sum * h * std::sqrt(radius / acceleration);
  }
  double time() const { return 2 * time_to(ramp()) + (angle - 2 * ramp()) * radius / top(); }
  double at(double t) const {  // rad
    if (t > time() / 2) return angle - at(std::max(time() - t, 0.0));
    const double end = time_to(ramp());
    if (t >= end) return ramp() + (t - end) * top() / radius;
    double low = 0, high = ramp();
    for (int k = 0; k < 45; ++k) {
      const double middle = (low + high) / 2;
      (time_to(middle) < t ? low : high) = middle;
    }
    return low;
  }
};

/// A natural cubic spline over the chords' lengths, by its second derivatives at the points.
struct Natural {
  std::vector<Vector3d> points;
  std::vector<double> at{0};
  Eigen::MatrixXd second;

  explicit Natural(const std::vector<Vector3d>& through) : points(through) {
    const int n = static_cast<int>(points.size());
    for (int k = 1; k < n; ++k) at.push_back(at.back() + (points[k] - points[k - 1]).norm());
    Eigen::MatrixXd A = Eigen::MatrixXd::Identity(n, n), b = Eigen::MatrixXd::Zero(n, 3);
    for (int k = 1; k + 1 < n; ++k) {
      const double h = at[k] - at[k - 1], g = at[k + 1] - at[k];
      A(k, k - 1) = h / 6;
      A(k, k) = (h + g) / 3;
      A(k, k + 1) = g / 6;
      b.row(k) = ((points[k + 1] - points[k]) / g - (points[k] - points[k - 1]) / h).transpose();
    }
    second = A.fullPivLu().solve(b);
  }
  Vector3d operator()(double share) const {
    const double u = share * at.back();
    int k = 1;
    while (k + 1 < static_cast<int>(at.size()) && u > at[k]) ++k;
    const double h = at[k] - at[k - 1], a = (at[k] - u) / h, b = 1 - a;
    const Vector3d m = second.row(k - 1), n = second.row(k);
    return a * points[k - 1] + b * points[k] +
           h * h / 6 * ((a * a * a - a) * m + (b * b * b - b) * n);
  }
};

/// At rest at both ends, before and after; the velocity is the derivative of the position and the
/// length that of the path.
void expect_consistent(const Trajectory& path) {
  const double end = path.duration(), h = end * 1e-6;
  for (const double t : {-1.0, -1e-9, 0.0}) {
    EXPECT_EQ(path.at(t).position, path.at(0).position);
    EXPECT_EQ(path.at(t).velocity, Vector3d(0, 0, 0));
  }
  for (const double t : {end, end + 1e-9, end + 77}) {
    EXPECT_EQ(path.at(t).position, path.at(end).position);
    EXPECT_EQ(path.at(t).velocity, Vector3d(0, 0, 0));
  }
  double length = 0;
  Vector3d last = path.at(0).position;
  const int n = 3000;
  for (int k = 1; k <= n; ++k) {
    const double t = end * k / n;
    length += (path.at(t).position - last).norm();
    last = path.at(t).position;
    if (k == n) break;
    const Vector3d slope = (path.at(t + h).position - path.at(t - h).position) / (2 * h);
    EXPECT_LE((slope - path.at(t).velocity).norm(), 1e-7) << t;
  }
  EXPECT_NEAR(length, path.length(), 1e-5 * length);
}

/// Nowhere over a limit but by the sampling's error, and everywhere at one: as fast as can be.
void expect_least_time(const Trajectory& path, const MotionLimits& limits, double tolerance) {
  const double end = path.duration();
  const int n = 2000;
  const double h = end / n / 8;
  int idle = 0;
  for (int k = 1; k < n - 1; ++k) {
    const double t = end * (k + 0.5) / n;
    const Vector3d along = path.at(t).velocity;
    const Vector3d change = (path.at(t + h).velocity - path.at(t - h).velocity) / (2 * h);
    const Vector3d across = change - along * along.dot(change) / along.squaredNorm();
    const double speed = along.norm() / limits.speed;
    const double acceleration = change.norm() / limits.acceleration;
    EXPECT_LE(speed, 1 + 1e-9);
    EXPECT_LE(acceleration, 1 + tolerance);
    const double bend = across.norm() / (kBend * limits.acceleration);
    if (std::max({speed, acceleration, bend}) < 1 - tolerance) ++idle;
  }
  EXPECT_LE(idle, n / 100);  // where one limit gives way to another
}

const std::vector<MotionLimits> kSlowAndFast{{0.7e-3, 1.3e-3}, {9e-3, 1.3e-3}};
const Vector3d kFrom(1.1e-3, -2e-3, 3e-3);

TEST(TrajectoryReference, lines_are_trapezoids_or_triangles_of_speed) {
  const Vector3d to(-2e-3, 1e-3, 2.2e-3), along = (to - kFrom).normalized();
  for (const MotionLimits& limits : kSlowAndFast) {
    const Trajectory path = Trajectory::line(kFrom, to, limits);
    const Straight expected{(to - kFrom).norm(), limits.speed, limits.acceleration};
    EXPECT_NEAR(path.duration(), expected.time(), 1e-6 * expected.time());
    EXPECT_NEAR(path.length(), expected.length, 1e-12 * expected.length);
    for (int k = 0; k <= 500; ++k) {
      const double t = expected.time() * k / 500;
      EXPECT_LE((path.at(t).position - kFrom - along * expected.at(t)).norm(), 1e-9) << t;
    }
    expect_consistent(path);
    expect_least_time(path, limits, 1e-6);
  }
  EXPECT_EQ(Trajectory::line(kFrom, kFrom, {}).duration(), 0);  // a place to hold
}

TEST(TrajectoryReference, rectangles_and_waypoints_go_from_corner_to_corner_and_rest_there) {
  const Vector3d side(2e-3, 0.4e-3, -0.5e-3), up(-0.1e-3, 0.3e-3, 0.2e-3);
  const std::vector<Vector3d> corners{kFrom, kFrom + side, kFrom + side + up, kFrom + up, kFrom};
  // Points that are met twice in a row count once.
  const std::vector<Vector3d> repeated{corners[0], corners[0], corners[1], corners[2], corners[2],
                                       corners[2], corners[3], corners[4], corners[4]};
  for (const MotionLimits& limits : kSlowAndFast) {
    for (const Trajectory& path :
         {Trajectory::rectangle(kFrom, side, up, limits), Trajectory::waypoints(corners, limits),
          Trajectory::waypoints(repeated, limits)}) {
      double begin = 0, length = 0;
      for (int k = 0; k < 4; ++k) {
        const Vector3d way = corners[k + 1] - corners[k];
        const Straight leg{way.norm(), limits.speed, limits.acceleration};
        for (int n = 0; n <= 100; ++n) {
          const double t = leg.time() * n / 100;
          const Vector3d place = corners[k] + way.normalized() * leg.at(t);
          EXPECT_LE((path.at(begin + t).position - place).norm(), 2e-9) << k << " " << n;
        }
        EXPECT_LE(path.at(begin).velocity.norm(), 1e-5);
        begin += leg.time();
        length += leg.length;
      }
      EXPECT_NEAR(path.duration(), begin, 1e-6 * begin);
      EXPECT_NEAR(path.length(), length, 1e-12 * length);
      expect_consistent(path);
    }
  }
}

TEST(TrajectoryReference, circles_turn_from_first_to_second) {
  const Vector3d center(-1e-3, 2e-3, 0.5e-3), first(0.8e-3, -0.5e-3, 1.1e-3);
  const Vector3d second = first.cross(Vector3d(1, 2, -0.3)).normalized() * first.norm();
  for (const MotionLimits& limits : kSlowAndFast) {
    for (const double turns : {0.1, 1.3, 3.0}) {
      const Trajectory path = Trajectory::circle(center, first, second, turns, limits);
      const Round expected{first.norm(), 2 * kPi * turns, limits.speed, limits.acceleration};
      EXPECT_NEAR(path.duration(), expected.time(), 5e-5 * expected.time());
      const double length = expected.radius * expected.angle;
      EXPECT_NEAR(path.length(), length, 2e-6 * length);
      double worst = 0;
      for (int k = 0; k <= 100; ++k) {
        const double t = expected.time() * k / 100, angle = expected.at(t);
        const Vector3d place = center + first * std::cos(angle) + second * std::sin(angle);
        worst = std::max(worst, (path.at(t).position - place).norm());
      }
      EXPECT_LE(worst, 1e-6);
      expect_consistent(path);
      expect_least_time(path, limits, 0.02);
    }
  }
}

TEST(TrajectoryReference, spirals_widen_as_they_climb) {
  for (const auto& [first, last] : {std::pair{0.7e-3, 2.9e-3}, std::pair{2.5e-3, 0.6e-3}}) {
    const Spiral shape{{1e-3, -2e-3, -3.3e-3}, 5e-3, first, last, 3.3};
    for (const MotionLimits& limits : kSlowAndFast) {
      const Trajectory path = Trajectory::spiral(shape, limits);
      double below = -1;
      for (int k = 0; k <= 1000; ++k) {
        const Vector3d place = path.at(path.duration() * k / 1000).position - shape.bottom;
        const double share = place.z() / 5e-3, angle = 2 * kPi * 3.3 * share;
        const double radius = first + (last - first) * share;
        const Vector3d there(radius * std::cos(angle), radius * std::sin(angle), place.z());
        EXPECT_LE((place - there).norm(), 1e-9);
        EXPECT_GT(share, below);
        below = share;
      }
      EXPECT_NEAR(path.at(0).position.z(), -3.3e-3, 1e-15);
      EXPECT_NEAR(path.at(path.duration()).position.z(), 1.7e-3, 1e-15);
      expect_consistent(path);
      expect_least_time(path, limits, 0.02);
    }
  }
  // 6 mm high and 7 mm wide at the top, by default
  const Trajectory usual = Trajectory::spiral({}, {});
  EXPECT_LE((usual.at(0).position - Vector3d(0.5e-3, 0, -3e-3)).norm(), 1e-12);
  EXPECT_LE((usual.at(usual.duration()).position - Vector3d(3.5e-3, 0, 3e-3)).norm(), 1e-12);
}

TEST(TrajectoryReference, splines_are_natural_over_the_chords_and_curves_go_by_their_shape_alone) {
  const std::vector<Vector3d> points{{1e-3, 2e-3, -3e-3},
                                     {2e-3, 1e-3, -2e-3},
                                     {4e-3, 1.5e-3, -1e-3},
                                     {4.2e-3, 3e-3, 0.3e-3},
                                     {1e-3, 3.5e-3, 0}};
  const Natural natural(points);
  std::vector<Vector3d> repeated = points;
  repeated.insert(repeated.begin() + 2, points[2]);
  for (const MotionLimits& limits : kSlowAndFast) {
    const Trajectory path = Trajectory::spline(points, limits);
    const Trajectory same = Trajectory::spline(repeated, limits);
    double low = 0, high = 0;
    // the same curve, begun slowly, at an uneven rate
    const Trajectory curve = Trajectory::curve(
        [&](double u) {
          low = std::min(low, u);
          high = std::max(high, u);
          return natural(u * (0.5 + u * (1.5 - u)));
        },
        limits);
    EXPECT_EQ(low, 0);
    EXPECT_EQ(high, 1);
    EXPECT_NEAR(curve.duration(), path.duration(), 5e-6 * path.duration());
    EXPECT_NEAR(curve.length(), path.length(), 1e-6 * path.length());
    EXPECT_LE((path.at(0).position - points.front()).norm(), 1e-15);
    EXPECT_LE((path.at(1e9).position - points.back()).norm(), 1e-15);
    for (int k = 0; k <= 300; ++k) {
      const double t = path.duration() * k / 300;
      EXPECT_LE((curve.at(t).position - path.at(t).position).norm(), 1e-7);
      EXPECT_EQ(same.at(t).position, path.at(t).position);
    }
    expect_consistent(path);
    expect_least_time(path, limits, 0.02);
  }
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::control
