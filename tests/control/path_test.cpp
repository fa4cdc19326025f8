// SPDX-License-Identifier: Apache-2.0
#include "control/path.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>
#include <vector>

namespace vitreo::control {
namespace {

const double kNan = std::numeric_limits<double>::quiet_NaN();

// The square of figure 6.5: 8 mm along x by 6 mm of depth.
Path square() {
  return Path({{-4e-3, 0, -3e-3}, {4e-3, 0, -3e-3}, {4e-3, 0, 3e-3}, {-4e-3, 0, 3e-3}, {-4e-3, 0, -3e-3}}, 5e-4);
}

Path random_path(std::mt19937_64& random, double speed) {
  std::uniform_real_distribution<double> place(-5e-3, 5e-3);
  std::uniform_int_distribution<int> count(2, 12);
  std::vector<Eigen::Vector3d> points;
  for (int k = count(random); k > 0; --k) {
    const double x = place(random), y = place(random), z = place(random);
    points.emplace_back(x, y, z);
  }
  return Path(std::move(points), speed);
}

TEST(Path, round_the_square_takes_as_long_as_its_sides_say) {
  EXPECT_NEAR(square().length(), 28e-3, 1e-15);
  EXPECT_NEAR(square().duration(), 56, 1e-12);
  const Reference middle = square().at(8);
  EXPECT_LT((middle.position - Eigen::Vector3d(0, 0, -3e-3)).norm(), 1e-15);
  EXPECT_LT((middle.velocity - Eigen::Vector3d(5e-4, 0, 0)).norm(), 1e-15);
}

TEST(Path, keeps_its_speed_and_never_jumps) {
  std::mt19937_64 random(1);
  for (int trial = 0; trial < 50; ++trial) {
    const double speed = 3e-4, step = 0.01;
    const Path path = random_path(random, speed);
    Reference before = path.at(0);
    for (double t = step; t < path.duration(); t += step) {
      const Reference now = path.at(t);
      EXPECT_NEAR(now.velocity.norm(), speed, 1e-12 * speed + 1e-15);
      EXPECT_LE((now.position - before.position).norm(), speed * step * (1 + 1e-9));  // a corner only shortens it
      before = now;
    }
  }
}

TEST(Path, moves_as_its_velocity_says_between_corners) {
  const Path path = square();
  for (const double t : {1.0, 15.9, 17.0, 30.0, 50.0}) {
    const Eigen::Vector3d moved = path.at(t + 0.01).position - path.at(t).position;
    EXPECT_LT((moved - 0.01 * path.at(t).velocity).norm(), 1e-15);  // straight: rounding
  }
}

TEST(Path, passes_every_waypoint_at_its_time) {
  std::mt19937_64 random(2);
  for (int trial = 0; trial < 50; ++trial) {
    const Path path = random_path(random, 1e-3);
    double time = 0;
    for (std::size_t k = 0; k < path.waypoints().size(); ++k) {
      if (k > 0) time += (path.waypoints()[k] - path.waypoints()[k - 1]).norm() / 1e-3;
      EXPECT_LT((path.at(time).position - path.waypoints()[k]).norm(), 1e-14);
    }
  }
}

TEST(Path, rests_before_its_start_and_from_its_end_on) {
  const Path path = square();
  EXPECT_EQ(path.at(-1).position, path.waypoints().front());
  EXPECT_EQ(path.at(-1).velocity.norm(), 0);
  EXPECT_GT(path.at(0).velocity.norm(), 0);
  for (const double t : {path.duration(), path.duration() + 1, std::numeric_limits<double>::infinity()}) {
    EXPECT_EQ(path.at(t).position, path.waypoints().back());
    EXPECT_EQ(path.at(t).velocity.norm(), 0);
  }
}

TEST(Path, takes_the_way_out_at_a_corner) {
  EXPECT_LT((square().at(16).velocity - Eigen::Vector3d(0, 0, 5e-4)).norm(), 1e-15);
}

TEST(Path, may_be_a_single_point_or_repeat_one) {
  const Path point({{1e-3, 0, 0}}, 1e-3);
  EXPECT_EQ(point.duration(), 0);
  EXPECT_EQ(point.at(0).position.x(), 1e-3);
  const Path repeated({{0, 0, 0}, {0, 0, 0}, {1e-3, 0, 0}, {1e-3, 0, 0}}, 1e-3);
  EXPECT_TRUE(repeated.at(0).position.allFinite());
  EXPECT_NEAR(repeated.at(0).velocity.x(), 1e-3, 1e-15);
  EXPECT_NEAR(repeated.duration(), 1, 1e-15);
}

TEST(Path, refuses_what_is_no_path) {
  EXPECT_THROW(Path({}, 1), std::invalid_argument);
  EXPECT_THROW(Path({{0, 0, kNan}}, 1), std::invalid_argument);
  EXPECT_THROW(Path({{0, 0, 0}, {1, 0, 0}}, 0), std::invalid_argument);
  EXPECT_THROW(Path({{0, 0, 0}, {1, 0, 0}}, kNan), std::invalid_argument);
  EXPECT_THROW(Path({{0, 0, 0}, {1, 0, 0}}, 1e-310), std::invalid_argument);
  EXPECT_THROW(square().at(kNan), std::invalid_argument);
}

}  // namespace
}  // namespace vitreo::control
