// Trajectories keep to their limits, pass where they should, and start and end at rest.
// SPDX-License-Identifier: Apache-2.0
#include "control/trajectory.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <stdexcept>

namespace vitreo::control {
namespace VITREO_TEST_FILE {

const MotionLimits kLimits{0.5e-3, 2e-3};

// Speed and acceleration by differences of the places alone, and the velocity against them.
void expect_within(const Trajectory& path, const MotionLimits& limits) {
  const double h = path.duration() / 20000;
  double fastest = 0, hardest = 0, off = 0;
  for (double t = 2 * h; t < path.duration() - 2 * h; t += h) {
    const Eigen::Vector3d a = path.at(t - h).position, b = path.at(t).position,
                          c = path.at(t + h).position;
    fastest = std::max(fastest, (c - a).norm() / (2 * h));
    hardest = std::max(hardest, (c - 2 * b + a).norm() / (h * h));
    off = std::max(off, (path.at(t).velocity - (c - a) / (2 * h)).norm());
  }
  EXPECT_LE(fastest, limits.speed * 1.001);  // differences over 1/20000 of the whole
  EXPECT_LE(hardest, limits.acceleration *
                         1.03);  // the sampled curvature's error, and the jumps between samples
  EXPECT_GT(hardest, limits.acceleration * 0.9);  // and no slower than it must
  EXPECT_LT(off, limits.acceleration * h * 1.1 + 1e-3 * limits.speed);
  EXPECT_EQ(path.at(-1).velocity.norm(), 0);
  EXPECT_EQ(path.at(path.duration() + 1).velocity.norm(), 0);
  EXPECT_LT(path.at(1e-9).velocity.norm(), 1e-3 * limits.speed);
}

TEST(Trajectory, of_a_point_stays_there) {
  const Trajectory path = Trajectory::hold_at({1, 2, 3});
  EXPECT_EQ(path.duration(), 0);
  EXPECT_EQ(path.at(5).position, Eigen::Vector3d(1, 2, 3));
  EXPECT_EQ(path.at(0).velocity.norm(), 0);
}

TEST(Trajectory, of_a_place_that_glides_keeps_its_velocity_and_rests_after_its_time) {
  const Eigen::Vector3d velocity(1e-3, -2e-3, 0);
  const Trajectory path = Trajectory::glide({1, 2, 3}, velocity, 0.5);
  EXPECT_EQ(path.duration(), 0.5);
  for (const double t : {0.0, 0.1, 0.49}) {
    EXPECT_LT((path.at(t).position - (Eigen::Vector3d(1, 2, 3) + t * velocity)).norm(), 1e-15);
    EXPECT_LT((path.at(t).velocity - velocity).norm(), 1e-15);
  }
  EXPECT_LT((path.at(9).position - (Eigen::Vector3d(1, 2, 3) + 0.5 * velocity)).norm(), 1e-15);
  EXPECT_EQ(path.at(9).velocity.norm(), 0);
  const Trajectory still = Trajectory::glide({1, 2, 3}, Eigen::Vector3d::Zero(), 0.5);
  EXPECT_EQ(still.duration(), 0);
  EXPECT_EQ(still.at(0.2).position, Eigen::Vector3d(1, 2, 3));
  EXPECT_THROW(Trajectory::glide({1, 2, 3}, velocity, 0), std::invalid_argument);
  EXPECT_THROW(Trajectory::glide({1, 2, 3}, velocity / 0.0, 1), std::invalid_argument);
}

TEST(Trajectory, along_a_line_takes_the_time_of_the_trapezium) {
  const Trajectory path = Trajectory::line({0, 0, 0}, {2e-3, 0, 0}, kLimits);
  EXPECT_NEAR(path.duration(), 2e-3 / 0.5e-3 + 0.5e-3 / 2e-3,
              1e-3);  // L/v + v/a; the samples round the corners off
  EXPECT_NEAR(path.length(), 2e-3, 1e-15);
  expect_within(path, kLimits);
  const Trajectory tiny =
      Trajectory::line({0, 0, 0}, {10e-6, 0, 0}, kLimits);  // never comes to full speed
  EXPECT_NEAR(tiny.duration(), 2 * std::sqrt(10e-6 / 2e-3), 1e-3);
}

TEST(Trajectory, around_a_rectangle_rests_in_the_corners) {
  const Trajectory path =
      Trajectory::rectangle({-4e-3, 0, -3e-3}, {8e-3, 0, 0}, {0, 0, 6e-3}, kLimits);
  EXPECT_NEAR(path.length(), 28e-3, 1e-12);
  EXPECT_NEAR(path.duration(), 28e-3 / 0.5e-3 + 4 * 0.25, 4e-3);
  expect_within(path, kLimits);
  const double first = 8e-3 / 0.5e-3 + 0.25;
  EXPECT_LT((path.at(first).position - Eigen::Vector3d(4e-3, 0, -3e-3)).norm(), 1e-6);
  EXPECT_LT(path.at(first).velocity.norm(), 1e-2 * kLimits.speed);
  EXPECT_EQ(path.at(1e3).position, Eigen::Vector3d(-4e-3, 0, -3e-3));
}

TEST(Trajectory, around_a_circle_keeps_its_radius_and_slows_for_the_bend) {
  const Eigen::Vector3d center(1e-3, 0, 0);
  const Trajectory path = Trajectory::circle(center, {3e-3, 0, 0}, {0, 3e-3, 0}, 2, kLimits);
  EXPECT_NEAR(path.length(), 4 * std::numbers::pi * 3e-3,
              2e-8);  // chords are short by 4e-7 of themselves
  expect_within(path, kLimits);
  for (double t = 0; t < path.duration(); t += 0.05) {
    EXPECT_NEAR((path.at(t).position - center).norm(), 3e-3, 1e-11);
  }
  // A bend too tight for the speed: v^2 / r may not go beyond the limit.
  const MotionLimits fast{10e-3, 2e-3};
  const Trajectory tight = Trajectory::circle(center, {0.2e-3, 0, 0}, {0, 0.2e-3, 0}, 3, fast);
  expect_within(tight, fast);
}

TEST(Trajectory, along_the_spiral_of_the_thesis_spans_what_it_spans) {
  const Trajectory path = Trajectory::spiral({}, kLimits);
  expect_within(path, kLimits);
  Eigen::Vector3d low(1, 1, 1), high(-1, -1, -1);
  for (double t = 0; t <= path.duration(); t += 0.02) {
    low = low.cwiseMin(path.at(t).position);
    high = high.cwiseMax(path.at(t).position);
  }
  EXPECT_NEAR(high.z() - low.z(), 6e-3, 1e-5);  // thesis 5.5
  EXPECT_NEAR(high.x() - low.x(), 7e-3,
              0.5e-3);  // half a turn before the widest it is that much narrower
}

TEST(Trajectory, along_a_spline_passes_through_the_waypoints_without_stopping) {
  const std::vector<Eigen::Vector3d> points{
      {0, 0, 0}, {2e-3, 1e-3, 0}, {2e-3, 1e-3, 0}, {3e-3, -1e-3, 1e-3}, {5e-3, 0, 2e-3}};
  const Trajectory path = Trajectory::spline(points, kLimits);
  expect_within(path, kLimits);
  for (const Eigen::Vector3d& point : points) {
    double nearest = 1, speed = 0;
    for (double t = 0; t <= path.duration(); t += 1e-3) {
      const Reference r = path.at(t);
      if ((r.position - point).norm() < nearest)
        nearest = (r.position - point).norm(), speed = r.velocity.norm();
    }
    EXPECT_LT(nearest, 0.6e-6);  // half a millisecond at full speed, and the sampling
    if (point != points.front() && point != points.back()) {
      EXPECT_GT(speed, 0.3 * kLimits.speed);
    }
  }
  EXPECT_EQ(Trajectory::spline({{0, 0, 0}, {1e-3, 0, 0}}, kLimits).length(),
            1e-3);  // two points: a line
}

TEST(Trajectory, through_waypoints_counts_a_point_met_twice_once) {
  EXPECT_EQ(Trajectory::waypoints({{1, 1, 1}, {1, 1, 1}}, kLimits).duration(), 0);
  EXPECT_EQ(Trajectory::waypoints({{1, 1, 1}}, kLimits).at(1).position, Eigen::Vector3d(1, 1, 1));
}

TEST(Trajectory, refuses_what_cannot_be_followed) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (const MotionLimits& bad :
       {MotionLimits{0, 1}, MotionLimits{1, 0}, MotionLimits{-1, 1}, MotionLimits{nan, 1}}) {
    EXPECT_THROW(Trajectory::line({0, 0, 0}, {1, 0, 0}, bad), std::invalid_argument);
    EXPECT_THROW(Trajectory::circle({0, 0, 0}, {1, 0, 0}, {0, 1, 0}, 1, bad),
                 std::invalid_argument);
  }
  EXPECT_THROW(Trajectory::waypoints({}, kLimits), std::invalid_argument);
  EXPECT_THROW(Trajectory::waypoints({{0, 0, nan}}, kLimits), std::invalid_argument);
  EXPECT_THROW(Trajectory::spline({{0, 0, 0}, {0, nan, 0}, {1, 1, 1}}, kLimits),
               std::invalid_argument);
  EXPECT_THROW(Trajectory::hold_at({0, 0, nan}), std::invalid_argument);
  EXPECT_THROW(Trajectory::circle({0, 0, 0}, {1, 0, 0}, {0.1, 1, 0}, 1, kLimits),
               std::invalid_argument);
  EXPECT_THROW(Trajectory::circle({0, 0, 0}, {1, 0, 0}, {0, 2, 0}, 1, kLimits),
               std::invalid_argument);
  Spiral flat;
  flat.height = 0;
  EXPECT_THROW(Trajectory::spiral(flat, kLimits), std::invalid_argument);
  EXPECT_THROW(Trajectory::curve([](double) { return Eigen::Vector3d(0, 0, 0); }, kLimits),
               std::invalid_argument);
  EXPECT_THROW(Trajectory::hold_at({0, 0, 0}).at(nan), std::invalid_argument);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::control
