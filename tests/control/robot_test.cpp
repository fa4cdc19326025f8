// SPDX-License-Identifier: Apache-2.0
#include "control/robot.h"

#include <Eigen/Dense>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>
#include <random>
#include <stdexcept>
#include <string>

namespace vitreo::control {
namespace VITREO_TEST_FILE {

Robot sphere(double radius) {
  return {"sphere",
          BodyShape::sphere,
          radius,
          radius,
          4.0 / 3.0 * std::numbers::pi * std::pow(radius, 3),
          7500,
          9.55e5,
          0,
          true};
}

std::string complaint(const Robot& robot) {
  try {
    robot.check();
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "";
}

TEST(Robot, of_coni_weighs_and_holds_what_the_table_says) {
  const Robot robot = coni_2mm();
  robot.check();
  // Printed to two or three digits; half of the last one.
  EXPECT_NEAR(robot.solid_volume, 0.128e-9, 0.0005e-9);
  EXPECT_NEAR(robot.mass(), 1.13e-6, 0.005e-6);
  EXPECT_NEAR(robot.net_weight(Medium{}), 9.86e-6, 0.005e-6);
  EXPECT_NEAR(robot.moment(20e-3), 7.3e-5, 1e-12);
  EXPECT_NEAR(robot.net_weight(Medium{}) / robot.moment(20e-3), 0.135, 0.0005);  // T/m to levitate
}

TEST(Robot, of_coni_sinks_as_the_table_says) {
  for (const double viscosity : {500e-6, 1000e-6}) {
    Medium oil;
    oil.kinematic_viscosity = viscosity;
    const Eigen::Matrix3d drag = resistance(coni_2mm(), oil, Eigen::Vector3d::UnitX());
    const double sink = coni_2mm().net_weight(oil) / drag(2, 2);
    EXPECT_NEAR(sink, 1565e-6 * 500e-6 / viscosity, 2e-6);  // the weight has three digits
  }
}

TEST(Robot, of_coni_drags_less_along_its_axis) {
  const Eigen::Matrix3d drag = resistance(coni_2mm(), Medium{}, Eigen::Vector3d::UnitX());
  EXPECT_NEAR(drag(0, 0), 5.5e-3, 0.05e-3);  // two printed digits
  EXPECT_NEAR(drag(1, 1), 6.3e-3, 0.05e-3);
  EXPECT_EQ(drag(1, 1), drag(2, 2));
}

TEST(Robot, drags_as_stokes_says_when_it_becomes_a_sphere) {
  const Medium oil;
  const double stokes = 6 * std::numbers::pi * oil.dynamic_viscosity() * 0.5e-3;
  EXPECT_LT(
      (resistance(sphere(0.5e-3), oil, {1, 2, 3}) - stokes * Eigen::Matrix3d::Identity()).norm(),
      1e-14);
  // Nearly a sphere: to first order in a/b - 1 the drag grows by 1/5 along and 2/5 across of it
  // (Happel).
  for (const double excess : {1e-9, 1e-6, 1e-3}) {
    Robot robot = sphere(0.5e-3);
    robot.semi_axis *= 1 + excess;
    const Eigen::Matrix3d drag = resistance(robot, oil, Eigen::Vector3d::UnitZ()) / stokes;
    EXPECT_NEAR(drag(2, 2), 1 + excess / 5,
                excess * excess + 1e-14);  // the second order, and rounding
    EXPECT_NEAR(drag(0, 0), 1 + 2 * excess / 5, excess * excess + 1e-14);
  }
}

TEST(Robot, drags_continuously_where_the_series_hands_over) {
  // Series below e^2 = 0.05, closed form above: the two agree there but for the closed form's
  // cancellation.
  const double a = 1e-3;
  Robot below = coni_2mm(), above = below;
  below.semi_radius = a * std::sqrt(1 - 0.05 * (1 - 1e-9));
  above.semi_radius = a * std::sqrt(1 - 0.05 * (1 + 1e-9));
  const Eigen::Matrix3d d =
      resistance(below, Medium{}, {0, 0, 1}) - resistance(above, Medium{}, {0, 0, 1});
  EXPECT_LT(d.norm(), 1e-10 * resistance(below, Medium{}, {0, 0, 1}).norm());
}

TEST(Robot, turns_its_drag_with_its_axis_and_always_loses_energy) {
  std::mt19937_64 random(1);
  std::normal_distribution<double> normal;
  const Eigen::Matrix3d along_x = resistance(coni_2mm(), Medium{}, Eigen::Vector3d::UnitX());
  for (int trial = 0; trial < 50; ++trial) {
    const double w = normal(random), x = normal(random), y = normal(random), z = normal(random);
    const Eigen::Matrix3d turn = Eigen::Quaterniond(w, x, y, z).normalized().toRotationMatrix();
    const Eigen::Matrix3d drag =
        resistance(coni_2mm(), Medium{}, 3 * turn.col(0));  // the length does not matter
    EXPECT_LT((drag - turn * along_x * turn.transpose()).norm(), 1e-15);  // rounding of 6e-3
    EXPECT_LT((drag - drag.transpose()).norm(), 1e-17);
    EXPECT_GT(drag.ldlt().vectorD().minCoeff(), 0);
  }
}

TEST(Robot, of_soft_magnet_grows_with_the_field_and_saturates) {
  const Robot robot = coni_2mm();
  EXPECT_EQ(robot.moment(0), 0);
  EXPECT_GT(robot.moment(10e-3), robot.moment(20e-3) / 2);  // concave
  EXPECT_LT(robot.moment(10e-3), robot.moment(20e-3));
  EXPECT_NEAR(robot.moment(1), robot.solid_volume * robot.saturation, 1e-12);
  Robot magnet = sphere(0.25e-3);
  EXPECT_EQ(magnet.moment(0), magnet.moment(1));
}

TEST(Robot, names_the_parameter_that_cannot_be) {
  Robot robot = coni_2mm();
  robot.semi_radius = 2e-3;
  EXPECT_NE(complaint(robot).find("semi_axis"), std::string::npos);
  robot = coni_2mm();
  robot.demagnetization = 0;
  EXPECT_NE(complaint(robot).find("demagnetization"), std::string::npos);
  robot = coni_2mm();
  robot.solid_volume = 1e-6;
  EXPECT_NE(complaint(robot).find("solid_volume"), std::string::npos);
  Medium oil;
  oil.kinematic_viscosity = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(oil.check(), std::invalid_argument);
  EXPECT_THROW(resistance(coni_2mm(), oil, {1, 0, 0}), std::invalid_argument);
  EXPECT_THROW(resistance(coni_2mm(), Medium{}, {0, 0, 0}), std::invalid_argument);
  EXPECT_THROW(static_cast<void>(coni_2mm().moment(-1)), std::invalid_argument);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::control
