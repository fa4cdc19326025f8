// Velocity control in a gel that yields: no overshoot, where the PD tuned in oil never arrives or overshoots.
// SPDX-License-Identifier: Apache-2.0
#include "control/velocity_control.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <deque>
#include <limits>
#include <numbers>
#include <stdexcept>

namespace vitreo::control {
namespace {

// Facts 3.2: Maxwell and Bingham, one axis, a 1 mm NdFeB cylinder in the gel like porcine vitreous (G' = 14 Pa).
class Gel {
 public:
  double step(double force, double span) {
    const double speed = (force - spring_) / kSolvent;
    const double yielding = std::copysign(std::max(0.0, std::abs(spring_) - kYield) / kPlastic, spring_);
    spring_ += span * kStiffness * (speed - yielding);
    return place_ += span * speed;
  }

 private:
  static constexpr double kRadius = 0.397e-3, kPi = std::numbers::pi;
  static constexpr double kStiffness = 6 * kPi * 14 * kRadius, kSolvent = 6 * kPi * 0.05 * kRadius,
                          kPlastic = 6 * kPi * 1 * kRadius, kYield = 14 * kPi * 0.25e-3 * 0.25e-3 * 16.8;
  double spring_ = 0, place_ = 0;
};

TEST(VelocityController, steps_a_millimetre_through_gel_without_overshoot) {
  VelocityController control({});
  Gel gel;
  std::deque<double> seen;
  double place = 0, highest = 0, force = 0, next = 0, arrived = -1;
  for (double t = 0; t < 60; t += 1e-3) {
    seen.push_back(place);
    if (seen.size() > 130) seen.pop_front();  // the measurement is 130 ms old
    if (t >= next) {
      next += 1.0 / 15;
      force = control.update(t, {seen.front(), 0, 0}, {{1e-3, 0, 0}, {0, 0, 0}}).x();
    }
    place = gel.step(force, 1e-3);
    highest = std::max(highest, place);
    if (arrived < 0 && place > 0.95e-3) arrived = t;
  }
  std::printf("  1 mm through gel: 95 %% after %.1f s, highest %.4f mm, end %.4f mm\n", arrived, 1e3 * highest,
              1e3 * place);
  EXPECT_LT(highest, 1.01e-3);  // the goal is none; a hundredth is for the creep at the yield
  EXPECT_NEAR(place, 1e-3, 0.02e-3);
  EXPECT_GT(arrived, 0);
  EXPECT_LT(arrived, 30);
}

TEST(VelocityController, winds_nothing_up_beyond_its_force) {
  VelocityGains gains;
  gains.max_force = 1e-6;
  VelocityController control(gains);
  for (int k = 0; k < 1000; ++k) {
    EXPECT_LE(control.update(0.1 * k, {0, 0, 0}, {{1, 0, 0}, {0, 0, 0}}).norm(), 1e-6 * (1 + 1e-12));
  }
  // A goal on the other side turns the force within the time its limit and gain give: 1e-6 / (0.05 0.2e-3) = 0.1 s.
  control.update(100.1, {0, 0, 0}, {{-1, 0, 0}, {0, 0, 0}});
  EXPECT_LT(control.update(100.3, {0, 0, 0}, {{-1, 0, 0}, {0, 0, 0}}).x(), 0);
  control.reset();
  EXPECT_EQ(control.update(0, {0, 0, 0}, {{1, 0, 0}, {0, 0, 0}}).norm(), 0);
}

TEST(VelocityController, names_what_is_wrong) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  VelocityController control({});
  control.update(1, {0, 0, 0}, {});
  EXPECT_THROW(control.update(0.9, {0, 0, 0}, {}), std::invalid_argument);
  EXPECT_THROW(control.update(nan, {0, 0, 0}, {}), std::invalid_argument);
  EXPECT_THROW(control.update(2, {nan, 0, 0}, {}), std::invalid_argument);
  EXPECT_THROW(control.limited_to({nan, 0, 0}), std::invalid_argument);
  EXPECT_THROW(control.update(2, {0, 0, 0}, {{nan, 0, 0}, {0, 0, 0}}), std::invalid_argument);
  for (double VelocityGains::*gain :
       {&VelocityGains::proportional, &VelocityGains::max_speed, &VelocityGains::integral, &VelocityGains::max_force}) {
    VelocityGains bad;
    bad.*gain = 0;
    EXPECT_THROW(VelocityController{bad}, std::invalid_argument);
  }
}

}  // namespace
}  // namespace vitreo::control
