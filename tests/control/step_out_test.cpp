// SPDX-License-Identifier: Apache-2.0
#include "control/step_out.h"

#include "control/robots.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>

namespace vitreo::control {
namespace VITREO_TEST_FILE {

constexpr double kTurn = 2 * std::numbers::pi;

/// The reference: angle of a body in a rotating field, z a' = m B sin(w t - a), by Runge and Kutta,
/// and its mean rate after the beginning.
double integrated_rotation(double frequency, double step_out) {
  const auto rate = [&](double t, double a) {
    return kTurn * step_out * std::sin(kTurn * frequency * t - a);
  };
  double a = 0, at_begin = 0, begin = 0;
  const double h = 1e-4;
  const int steps = 400000;  // 40 s
  for (int k = 0; k < steps; ++k) {
    const double t = k * h;
    if (k == steps / 4) {
      at_begin = a;
      begin = t;
    }
    const double k1 = rate(t, a), k2 = rate(t + h / 2, a + h / 2 * k1),
                 k3 = rate(t + h / 2, a + h / 2 * k2), k4 = rate(t + h, a + h * k3);
    a += h / 6 * (k1 + 2 * k2 + 2 * k3 + k4);
  }
  return (a - at_begin) / kTurn / (steps * h - begin);
}

TEST(StepOut, MeanRotationIsThatOfTheEquationOfTheLag) {
  for (const double frequency : {2.0, 7.9, 8.5, 10.0, 16.0})
    EXPECT_NEAR(mean_rotation(frequency, 8), integrated_rotation(frequency, 8), 0.05) << frequency;
  EXPECT_NEAR(mean_rotation(10, 8), 4, 1e-12);  // 10 - 6
}

TEST(StepOut, IsFoundFromThePartThatIsLeft) {
  for (const double frequency : {8.2, 9.0, 12.0, 20.0})
    EXPECT_NEAR(step_out_of(frequency, mean_rotation(frequency, 8) / frequency), 8, 1e-9);
}

// Of the torques' maxima: m B of a magnet; mu0 V / 2 (N_r - N_a) / (N_r N_a) H^2 of a soft body
// below saturation, which turns by either end.
TEST(StepOut, FrequencyIsLinearInTheFieldOfAMagnetAndSquareOfASoftRobot) {
  const Medium oil;
  const Robot magnet = robot_named("ndfeb_sphere_500um"), soft = robot_named("coni_2mm");
  EXPECT_NEAR(step_out_frequency(magnet, oil, 4e-3) / step_out_frequency(magnet, oil, 2e-3), 2,
              1e-3);
  EXPECT_NEAR(step_out_frequency(soft, oil, 2e-3) / step_out_frequency(soft, oil, 1e-3), 4, 0.05);
  EXPECT_NEAR(step_out_frequency(magnet, oil, 2e-3),
              magnet.moment(2e-3) * 2e-3 / (kTurn * rotational_resistance(magnet, oil)), 1e-6);
}

/// A robot seen 15 times a second that turns with a field up to `step_out`, driven at a frequency
/// that leaps at `leap` seconds. Returns the time from there to the verdict; negative: none.
double told_after(StepOutWatch& watch, double before, double after, double step_out, double advance,
                  unsigned seed, double noise = 4.3e-6) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal(0, noise);
  const double span = 1 / 15.0, leap = 5;
  double x = 0, seen = normal(random);
  for (int k = 1; k < 150; ++k) {
    const double frequency = k * span < leap ? before : after;
    x += advance * mean_rotation(frequency, step_out) * span;
    const double now = x + normal(random);
    if (watch.add(now - seen, advance * frequency * span, span, frequency)) return k * span - leap;
    seen = now;
  }
  return -1e9;
}

TEST(StepOut, IsToldWithinASecondAndItsFrequencyFound) {
  for (unsigned seed = 1; seed <= 40; ++seed) {
    StepOutWatch watch({});
    const double after = told_after(watch, 6, 10, 9, 0.188e-3, seed);
    EXPECT_GT(after, 0);
    EXPECT_LT(after, 0.7);
  }
}

TEST(StepOut, IsNotToldOfARobotInStepWhoseAdvanceIsNotTheBelievedOne) {
  for (const double advance : {0.9, 1.0, 1.15})
    for (unsigned seed = 1; seed <= 40; ++seed) {
      std::mt19937 random(seed);
      std::normal_distribution<double> normal(0, 4.3e-6);
      StepOutWatch watch({});
      double seen = normal(random), x = 0;
      for (int k = 1; k < 15 * 60; ++k) {  // a minute
        const double way = 0.188e-3 * (3 + 2 * std::sin(k / 40.0)) / 15;
        x += advance * way;
        const double now = x + normal(random);
        EXPECT_FALSE(watch.add(now - seen, way, 1 / 15.0, 5));
        seen = now;
      }
      EXPECT_NEAR(watch.response().before, advance, 0.02);
    }
}

// Where the slip on a wall is not known, a response of a fifth is no step-out; its fall is.
TEST(StepOut, LearnsAnUnknownResponseFirst) {
  StepOutSettings settings;
  settings.known = false;
  StepOutWatch steady(settings);
  for (int k = 0; k < 600; ++k) EXPECT_FALSE(steady.add(20e-6, 100e-6, 1 / 15.0, 3));
  EXPECT_NEAR(steady.response().before, 0.2, 0.01);
  bool told = false;
  for (int k = 0; k < 15 && !told; ++k) told = steady.add(5e-6, 100e-6, 1 / 15.0, 3);
  EXPECT_TRUE(told);
  EXPECT_FALSE(steady.settled());
  steady.recovered();
  for (int k = 0; k < 15; ++k) EXPECT_FALSE(steady.add(20e-6, 100e-6, 1 / 15.0, 2));
  EXPECT_TRUE(steady.settled());
}

// A robot that is hardly driven shows nothing: no verdict of noise.
TEST(StepOut, IsNotJudgedFromNoise) {
  std::mt19937 random(3);
  std::normal_distribution<double> normal(0, 4.3e-6);
  StepOutWatch watch({});
  for (int k = 0; k < 5000; ++k) EXPECT_FALSE(watch.add(normal(random), 1e-6, 1 / 15.0, 0.3));
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::control
