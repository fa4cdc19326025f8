// SPDX-License-Identifier: Apache-2.0
#include "control/pd.h"

#include <gtest/gtest.h>

#include <cmath>
#include <deque>
#include <limits>
#include <random>
#include <stdexcept>

namespace vitreo::control {
namespace VITREO_TEST_FILE {

const double kNan = std::numeric_limits<double>::quiet_NaN();
const Eigen::Vector3d kZero = Eigen::Vector3d::Zero();

TEST(PdController, asks_for_the_references_velocity_where_the_robot_is_on_it) {
  PdController control({});
  const Reference reference{{1e-3, 0, 0}, {5e-4, 0, 0}};
  EXPECT_EQ(control.update(0, reference.position, reference), reference.velocity);
}

TEST(PdController, asks_for_a_speed_in_proportion_to_the_error_up_to_the_limit) {
  PdGains gains;
  gains.derivative = 0;
  PdController control(gains);
  const Eigen::Vector3d near = control.update(0, kZero, {{1e-4, 0, 2e-4}, kZero});
  EXPECT_LT((near - Eigen::Vector3d(1.5e-4, 0, 3e-4)).norm(), 1e-18);  // rounding
  const Eigen::Vector3d far = control.update(1, kZero, {{3, 0, 4}, kZero});
  EXPECT_NEAR(far.norm(), gains.max_speed, 1e-15);
  EXPECT_NEAR(far.x() / far.z(), 0.75, 1e-12);  // the direction is kept
}

TEST(PdController, a_limit_of_the_moment_counts_where_it_is_below_its_own_and_holds_the_sum_too) {
  PdGains gains;
  gains.proportional = 0;
  gains.derivative = 0;
  gains.integral = 1;
  PdController control(gains);
  const Reference away{{1e-3, 0, 0}, kZero};
  control.update(0, kZero, away);
  EXPECT_NEAR(control.update(1, kZero, away, 1).x(), 1e-3, 1e-15) << "the own one is lower";
  EXPECT_NEAR(control.update(2, kZero, away, 0.5e-3).x(), 0.5e-3, 1e-15);
  EXPECT_NEAR(control.update(2.5, kZero, away).x(), 1.5e-3, 1e-15) << "from the 1 mm/s on";
  EXPECT_THROW(control.update(3, kZero, away, 0), std::invalid_argument);
  EXPECT_THROW(control.update(3, kZero, away, std::nan("")), std::invalid_argument);
}

TEST(PdController, damps_by_the_measured_velocity_that_it_smooths) {
  PdGains gains;
  gains.proportional = 0;
  gains.derivative = 1;
  PdController control(gains);
  for (int k = 0; k <= 100; ++k) {
    const double t = 0.05 * k;
    const Eigen::Vector3d asked = control.update(t, {1e-4 * t, 0, 0}, {});
    // First-order smoothing, backward Euler: 1 - (1 + dt/tau)^-k of the true 1e-4 m/s.
    EXPECT_NEAR(asked.x(), -1e-4 * (1 - std::pow(1.25, -k)), 1e-15);
  }
}

TEST(PdController, sums_the_error_up_until_its_speed_is_limited) {
  PdGains gains;
  gains.proportional = 0;
  gains.derivative = 0;
  gains.integral = 2;
  gains.max_speed = 1e-3;
  PdController control(gains);
  const Reference away{{1e-4, 0, 0}, kZero};
  EXPECT_EQ(control.update(0, kZero, away), kZero);
  EXPECT_NEAR(control.update(1, kZero, away).x(), 2e-4, 1e-18);
  EXPECT_NEAR(control.update(2, kZero, away).x(), 4e-4, 1e-18);
  for (int k = 3; k < 100; ++k) control.update(k, kZero, away);
  // Nothing is wound up beyond the limit: as long back as it takes from there.
  EXPECT_NEAR(control.update(100, {2e-4, 0, 0}, away).x(), 0.8e-3, 1e-12);
  control.reset();
  EXPECT_EQ(control.update(0, kZero, away), kZero);
  gains.integral = -1;
  EXPECT_THROW(PdController{gains}, std::invalid_argument);
}

TEST(PdController, has_no_derivative_at_the_first_measurement_nor_after_a_reset) {
  PdController control({});
  const Reference rest;
  control.update(0, {1e-3, 0, 0}, rest);
  control.update(1, {0, 0, 0}, rest);
  control.reset();
  EXPECT_EQ(control.update(0.5, kZero, rest), kZero);  // and the time may start over
}

TEST(PdController, takes_two_measurements_of_one_moment_and_irregular_ones) {
  PdGains gains;
  gains.proportional = 0;
  gains.derivative = 1;
  gains.derivative_time = 0;
  PdController control(gains);
  control.update(0, kZero, {});
  const Eigen::Vector3d before = control.update(0.1, {1e-5, 0, 0}, {});
  EXPECT_EQ(control.update(0.1, {9e-5, 0, 0}, {}), before);
  EXPECT_NEAR(control.update(0.4, {4e-5, 0, 0}, {}).x(), -1e-4,
              1e-15);  // from the first of the two
}

TEST(PdController, refuses_time_that_runs_backwards_and_what_is_no_number) {
  PdController control({});
  control.update(1, kZero, {});
  EXPECT_THROW(control.update(0.999, kZero, {}), std::invalid_argument);
  EXPECT_THROW(control.update(kNan, kZero, {}), std::invalid_argument);
  EXPECT_THROW(control.update(2, {0, kNan, 0}, {}), std::invalid_argument);
  EXPECT_THROW(control.update(2, kZero, {{kNan, 0, 0}, kZero}), std::invalid_argument);
  EXPECT_NO_THROW(control.update(2, kZero, {}));  // a refused update leaves no trace
}

TEST(PdController, refuses_gains_that_cannot_be) {
  const auto with = [](auto change) {
    PdGains gains;
    change(gains);
    return gains;
  };
  EXPECT_THROW(PdController(with([](PdGains& g) { g.proportional = -1; })), std::invalid_argument);
  EXPECT_THROW(PdController(with([](PdGains& g) { g.derivative = kNan; })), std::invalid_argument);
  EXPECT_THROW(PdController(with([](PdGains& g) { g.derivative_time = -0.1; })),
               std::invalid_argument);
  EXPECT_THROW(PdController(with([](PdGains& g) { g.max_speed = 0; })), std::invalid_argument);
}

TEST(PdController, brings_a_delayed_robot_to_the_reference_with_its_default_gains) {
  std::mt19937_64 random(1);
  std::normal_distribution<double> noise(0, 20e-6);
  for (int trial = 0; trial < 10; ++trial) {
    PdController control({});
    const Eigen::Vector3d goal(1e-3, -2e-3, 0.5e-3);
    Eigen::Vector3d p = kZero;
    std::deque<Eigen::Vector3d> late(
        2, kZero);  // two frames: the 130 ms of the thesis' camera and coils
    for (int k = 0; k < 300; ++k) {
      const double x = noise(random), y = noise(random), z = noise(random);
      late.push_back(p + Eigen::Vector3d(x, y, z));
      p += control.update(k / 15.0, late.front(), {goal, kZero}) / 15;
      late.pop_front();
    }
    EXPECT_LT((p - goal).norm(),
              60e-6);  // a gain of 0.1 a frame leaves a quarter of the noise an axis; ten of those
  }
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::control
