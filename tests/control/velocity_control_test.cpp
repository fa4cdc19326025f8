// Velocity control in a gel that yields: no overshoot, where the PD tuned in oil never arrives or
// overshoots.
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
namespace VITREO_TEST_FILE {

constexpr double kRadius = 0.397e-3,
                 kPi = std::numbers::pi;  // m, of the ball with the drag of a 1 mm NdFeB cylinder

// Facts 3.2: Maxwell and Bingham, one axis, in a gel of the modulus G' (14 Pa: like porcine
// vitreous).
class Gel {
 public:
  explicit Gel(double modulus)
      : stiffness_(6 * kPi * modulus * kRadius), yield_(modulus * kPi * 0.25e-3 * 0.25e-3 * 16.8) {}
  double step(double force, double span) {
    const double speed = (force - spring_) / kSolvent;
    const double yielding =
        std::copysign(std::max(0.0, std::abs(spring_) - yield_) / kPlastic, spring_);
    spring_ += span * stiffness_ * (speed - yielding);
    return place_ += span * speed;
  }

 private:
  static constexpr double kSolvent = 6 * kPi * 0.05 * kRadius, kPlastic = 6 * kPi * 1 * kRadius;
  const double stiffness_, yield_;
  double spring_ = 0, place_ = 0;
};

struct Way {
  double highest = 0, end = 0, arrived = -1;  // m, m, s to 95 %
};

/// A millimeter at 15 readings a second, each 130 ms old.
Way step_through(Gel gel, const VelocityGains& gains) {
  VelocityController control(gains);
  std::deque<double> seen;
  double place = 0, force = 0, next = 0;
  Way way;
  for (double t = 0; t < 90; t += 1e-3) {
    seen.push_back(place);
    if (seen.size() > 130) seen.pop_front();
    if (t >= next) {
      next += 1.0 / 15;
      force = control.update(t, {seen.front(), 0, 0}, {{1e-3, 0, 0}, {0, 0, 0}}).x();
    }
    place = gel.step(force, 1e-3);
    way.highest = std::max(way.highest, place);
    if (way.arrived < 0 && place > 0.95e-3) way.arrived = t;
  }
  way.end = place;
  return way;
}

TEST(VelocityController, steps_a_millimeter_through_soft_and_stiff_gels_without_overshoot) {
  for (const double modulus : {2.8, 6.0, 14.0}) {
    const Way way = step_through(Gel(modulus), {});
    std::printf("  1 mm through %.1f Pa: 95 %% after %.1f s, highest %.4f mm, end %.4f mm\n",
                modulus, way.arrived, 1e3 * way.highest, 1e3 * way.end);
    EXPECT_LT(way.highest, 1.01e-3)
        << modulus << " Pa";  // the goal is none; a hundredth is for the creep at the yield
    EXPECT_NEAR(way.end, 1e-3, 0.02e-3) << modulus << " Pa";
    EXPECT_GT(way.arrived, 0) << modulus << " Pa";
    EXPECT_LT(way.arrived, 60) << modulus << " Pa";
  }
}

TEST(VelocityController, is_faster_where_its_gain_suits_the_gel) {
  VelocityGains suited;
  suited.integral = 0.4 * 6 * kPi * 14 * kRadius;
  const Way way = step_through(Gel(14), suited);
  EXPECT_LT(way.highest, 1.01e-3);
  EXPECT_NEAR(way.end, 1e-3, 0.02e-3);
  EXPECT_LT(way.arrived, 30);
}

TEST(VelocityController, winds_nothing_up_beyond_its_force) {
  VelocityGains gains;
  gains.max_force = 1e-6;
  VelocityController control(gains);
  for (int k = 0; k < 1000; ++k) {
    EXPECT_LE(control.update(0.1 * k, {0, 0, 0}, {{1, 0, 0}, {0, 0, 0}}).norm(),
              1e-6 * (1 + 1e-12));
  }
  // A goal on the other side turns the force within the time its limit and gain give: 1e-6 / (0.01
  // 0.2e-3) = 0.5 s.
  control.update(100.1, {0, 0, 0}, {{-1, 0, 0}, {0, 0, 0}});
  EXPECT_LT(control.update(100.7, {0, 0, 0}, {{-1, 0, 0}, {0, 0, 0}}).x(), 0);
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
  for (double VelocityGains::*gain : {&VelocityGains::proportional, &VelocityGains::max_speed,
                                      &VelocityGains::integral, &VelocityGains::max_force}) {
    VelocityGains bad;
    bad.*gain = 0;
    EXPECT_THROW(VelocityController{bad}, std::invalid_argument);
  }
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::control
