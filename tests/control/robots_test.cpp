// The robots against the table of published and computed figures; walls; the saturating ellipsoid.
// SPDX-License-Identifier: Apache-2.0
#include "control/robots.h"

#include "tests/control/field_support.h"

#include <Eigen/Geometry>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>
#include <string>

namespace vitreo::control {
namespace VITREO_TEST_FILE {

constexpr double kMu0 = 4e-7 * std::numbers::pi;

TEST(RobotNamed, gives_the_robots_of_the_table) {
  struct Row {
    const char* name;
    double mass, weight, moment, sinking;  // kg, N, A m^2 at 20 mT, m/s in 500 cSt
  };
  // Facts 3.1, printed to two or three digits: 3 % for those of two.
  for (const Row& row : {Row{"coni_2mm", 1.13e-6, 9.86e-6, 7.3e-5, 1565e-6},
                         Row{"ni_500um", 0.033e-6, 0.29e-6, 1.1e-6, 184e-6},
                         Row{"ndfeb_sphere_500um", 0.491e-6, 4.19e-6, 6.2e-5, 1834e-6},
                         Row{"ndfeb_cylinder_1mm", 1.47e-6, 12.6e-6, 1.9e-4, 3991e-6}}) {
    const Robot robot = robot_named(row.name);
    EXPECT_NO_THROW(robot.check()) << row.name;
    const double weight = robot.net_weight(Medium{});
    EXPECT_NEAR(robot.mass(), row.mass, 0.03 * row.mass) << row.name;
    EXPECT_NEAR(weight, row.weight, 0.03 * row.weight) << row.name;
    EXPECT_NEAR(robot.moment(0.02), row.moment, 0.03 * row.moment) << row.name;
    const double sinking =
        weight / resistance(robot, Medium{}, {1, 0, 0})(2, 2);  // lying on its side, as the table
    EXPECT_NEAR(sinking, row.sinking, 0.03 * row.sinking) << row.name;
  }
  EXPECT_EQ(robot_names().size(), 6U)
      << "and the swimmers, whose numbers are in helix_test and oscillating_field_test";
}

TEST(RobotNamed, lists_the_names_there_are) {
  try {
    robot_named("gold");
    FAIL();
  } catch (const std::invalid_argument& error) {
    EXPECT_NE(std::string(error.what()).find("ndfeb_sphere_500um"), std::string::npos);
  }
}

TEST(ResistanceNearWall, is_faxens_and_the_free_one_far_away) {
  const Robot robot = ndfeb_sphere_500um();
  const Eigen::Matrix3d free = resistance(robot, Medium{}, {1, 0, 0});
  const double radius = 0.25e-3, h = 1e-3, x = radius / h;
  const Eigen::Matrix3d near = resistance_near_wall(free, robot, {0, 0, 1}, h);
  EXPECT_NEAR(near(0, 0) / free(0, 0), 1 / (1 - 9. / 16 * x + x * x * x / 8), 1e-12);
  EXPECT_NEAR(near(2, 2) / free(2, 2), 1 / (1 - 9. / 8 * x + x * x * x / 2), 1e-12);
  EXPECT_NEAR(near(0, 2) / free(0, 0), 0, 1e-12);
  EXPECT_LT((resistance_near_wall(free, robot, {0, 0, 1}, 1e3) - free).norm(),
            1e-6 * free.norm());  // 9R/8h
  // Nearer is never easier, and at touch still a number.
  double last = 0;
  for (double distance = 5e-3; distance > 1e-5; distance *= 0.9) {
    const double now = resistance_near_wall(free, robot, {0, 0, 1}, distance)(2, 2);
    EXPECT_GE(now, last);
    last = now;
  }
  const Eigen::Matrix3d askew = resistance_near_wall(resistance(coni_2mm(), Medium{}, {1, 1, 1}),
                                                     coni_2mm(), {0, 1, 0.5}, 2e-3);
  EXPECT_LT((askew - askew.transpose()).norm(), 1e-12 * askew.norm());
  EXPECT_THROW(resistance_near_wall(free, robot, {0, 0, 1}, 0), std::invalid_argument);
  EXPECT_THROW(resistance_near_wall(free, robot, {0, 0, 0}, 1), std::invalid_argument);
}

TEST(DemagnetizingFactors, sum_to_one_and_meet_the_closed_form_of_spheroids) {
  std::mt19937_64 random(1);
  std::uniform_real_distribution<double> size(0.05, 1);
  for (int trial = 0; trial < 100; ++trial) {
    const double a = size(random), b = size(random), c = size(random);
    EXPECT_NEAR(demagnetizing_factors({a, b, c}).sum(), 1, 1e-12);
  }
  EXPECT_LT((demagnetizing_factors({2, 2, 2}) - Eigen::Vector3d::Constant(1. / 3)).norm(), 1e-14);
  const double m = 4, e = std::sqrt(m * m - 1);  // Osborn: prolate, axes 4 to 1
  EXPECT_NEAR(demagnetizing_factors({4, 1, 1})[0], (m / e * std::log(m + e) - 1) / (m * m - 1),
              1e-13);
  EXPECT_THROW(demagnetizing_factors({1, 0, 1}), std::invalid_argument);
}

TEST(SoftMoment, is_linear_below_saturation_and_minimizes_the_energy_above) {
  const SoftBody body{1e-10, 1.19e6, demagnetizing_factors({1e-3, 0.5e-3, 0.2e-3})};
  const Eigen::Vector3d weak(1e-3, 2e-3, -1e-3);
  EXPECT_LT(
      (soft_moment(body, weak) - body.volume * (weak / kMu0).cwiseQuotient(body.factors)).norm(),
      1e-18);
  std::mt19937_64 random(2);
  for (int trial = 0; trial < 200; ++trial) {
    const Eigen::Vector3d b = (trial % 2 == 0 ? 0.5 : 5.0) * any_direction(random), h = b / kMu0;
    const Eigen::Vector3d m = soft_moment(body, b) / body.volume;
    if ((h.cwiseQuotient(body.factors)).norm() <= body.saturation) continue;
    EXPECT_NEAR(m.norm(), body.saturation, 1e-9 * body.saturation);  // Newton ends at 1e-14
    const auto energy = [&](const Eigen::Vector3d& at) {
      return 0.5 * at.dot(body.factors.cwiseProduct(at)) - at.dot(h);
    };
    for (int other = 0; other < 50; ++other) {  // no other direction has less
      const Eigen::Vector3d tried =
          body.saturation * (m.normalized() + 0.05 * any_direction(random)).normalized();
      EXPECT_GE(energy(tried), energy(m) - 1e-9 * std::abs(energy(m)));
    }
  }
}

TEST(SoftMoment, has_no_more_torque_than_the_anisotropy_allows) {
  const SoftBody body{1e-10, 1.19e6, demagnetizing_factors({1e-3, 0.5e-3, 0.5e-3})};
  const double most =
      0.5 * kMu0 * body.volume * (body.factors[1] - body.factors[0]) * std::pow(body.saturation, 2);
  double largest = 0;
  for (double size = 0.05; size < 3; size *= 1.2) {
    for (double angle = 0; angle < 1.57; angle += 0.01) {
      const Eigen::Vector3d b = size * Eigen::Vector3d(std::cos(angle), std::sin(angle), 0);
      largest = std::max(largest, soft_moment(body, b).cross(b).norm());
    }
  }
  EXPECT_LE(largest, most * (1 + 1e-9));
  EXPECT_GT(largest, 0.98 * most);  // and it is reached, within the grid
  EXPECT_THROW(soft_moment({0, 1, {0.3, 0.3, 0.4}}, {1, 0, 0}), std::invalid_argument);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::control
