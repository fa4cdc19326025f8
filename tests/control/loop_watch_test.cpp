// Watches of a loop: an oscillation and a standstill are named, a square and noise are not; a coil
// that lacks current is told from the others.
// SPDX-License-Identifier: Apache-2.0
#include "control/coil_watch.h"
#include "control/motion_watch.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <stdexcept>
#include <vector>

namespace vitreo::control {
namespace {

constexpr double kPeriod = 1 / 15.0;
constexpr double kNoise = 4.3e-6;

struct Motions {
  std::mt19937_64 random{7};
  std::normal_distribution<double> normal;

  WatchedMotion at(double time, const Eigen::Vector3d& error) {
    WatchedMotion now;
    now.time = time;
    now.sigma = kNoise;
    now.error = error + kNoise * Eigen::Vector3d(normal(random), normal(random), normal(random));
    now.position = now.error;
    return now;
  }
};

TEST(MotionWatch, ALimitCycleIsNamedWithinTenSecondsWithItsPeriod) {
  for (const double period : {0.5, 0.8, 1.5}) {
    MotionWatch watch;
    Motions motions;
    double named = -1;
    for (double time = 0; time < 10; time += kPeriod) {
      const double error = 60e-6 * std::sin(2 * M_PI * time / period);
      watch.add(motions.at(time, {0, 0, error}));
      if (watch.oscillating() && named < 0) named = time;
    }
    EXPECT_GE(named, 0) << period;
    EXPECT_NEAR(watch.period(), period, 0.15 * period + kPeriod);
    EXPECT_NEAR(watch.amplitude(), 60e-6, 15e-6);
  }
}

TEST(MotionWatch, NoiseAWanderingErrorAndTheCornersOfASquareAreNoOscillation) {
  MotionWatch watch;
  Motions motions;
  double wander = 0;
  int named = 0;
  for (double time = 0; time < 3600; time += kPeriod) {
    wander += -wander * kPeriod / 2 + 4e-6 * motions.normal(motions.random);
    const double corner = 40e-6 * std::exp(-std::fmod(time, 12.0) / 0.7);
    watch.add(motions.at(time, {wander, corner, 0}));
    named += watch.oscillating() ? 1 : 0;
  }
  EXPECT_EQ(named, 0);
}

// Recorded, um: the error along y of servo_supervised's PD (seed 1) as it comes to one point and
// leaves for the next. Over five seconds its autocorrelation is that of a cycle of 1.6 s.
TEST(MotionWatch, ComingToAPointAndLeavingForTheNextIsNoOscillation) {
  const std::vector<double> errors = {
      20,  20,  20,  20,  20,  20,  20,  20,  20,  20, 20, 20, 20, 20, 20, 20,  20,  20,  20,  20,
      20,  20,  20,  19,  19,  19,  19,  19,  20,  19, 19, 19, 19, 16, 5,  -14, -37, -54, -60, -56,
      -49, -42, -35, -28, -24, -20, -16, -13, -11, -9, -7, -5, -4, -2, -1, 0,   0,   1,   2,   1,
      -2,  -6,  -11, -14, -15, -14, -13, -12, -10, -9, -8, -7, -6, -6, -5, -5,  -5,  -4,  -4,  -3,
      -3,  -3,  -2,  -2,  -3,  -2,  -2,  -2,  -2,  -2, -2, -2, -2, -2, -2, -1,  -2,  -2,  -2,  -2,
      -2,  -2,  -2,  -2,  -1,  -1,  -2,  -2,  -1,  -2, -2, -2, -2, -2, -2};
  MotionWatch watch;
  for (std::size_t n = 0; n < errors.size(); ++n) {
    WatchedMotion now;
    now.time = static_cast<double>(n) * kPeriod;
    now.sigma = 2e-6;
    now.error.y() = 1e-6 * errors[n];
    watch.add(now);
    EXPECT_FALSE(watch.oscillating()) << now.time;
  }
}

TEST(MotionWatch, ARobotThatIsToldToMoveAndStandsIsNamedAndOneThatMovesIsNot) {
  for (const bool stands : {true, false}) {
    MotionWatch watch;
    Motions motions;
    for (double time = 0; time < 5; time += kPeriod) {
      WatchedMotion now = motions.at(time, {0, 0, 0});
      now.wanted = {0.5e-3, 0, 0};
      if (!stands) now.position.x() += 0.4e-3 * time;
      watch.add(now);
    }
    EXPECT_EQ(watch.standing(), stands);
  }
}

// A filter with fixed gains on one place; coils push along directions of their own with tones of
// their own. What coil 3 does not do is in the measurements.
TEST(CoilWatch, TheCoilThatCarriesLessIsToldWithThePartThatItLacks) {
  constexpr int kCoils = 4;
  CoilWatch watch(kCoils);
  std::mt19937_64 random(3);
  std::normal_distribution<double> normal;
  const Eigen::Matrix3d gain_p = 0.3 * Eigen::Matrix3d::Identity(),
                        gain_v = 0.7 * Eigen::Matrix3d::Identity();
  const Eigen::Vector3d directions[kCoils] = {
      {1, 0, 0}, {0, 1, 0.3}, {0.5, 0.5, 0.7}, {-0.2, 0.4, 1}};
  Eigen::Vector3d truth(0, 0, 0), p(0, 0, 0), v(0, 0, 0);
  constexpr double kLack = 0.7;
  for (int n = 0; n < 75; ++n) {
    CoilMotions given(3, kCoils);
    for (int k = 0; k < kCoils; ++k)
      given.col(k) =
          directions[k] * 5e-6 * std::sin(2 * M_PI * (1.6 * n * kPeriod + k / 8.0)) * 1.5;
    truth -= kLack * given.col(2);
    p += kPeriod * v;
    Innovation innovation;
    innovation.value = truth - p;
    for (double& one : innovation.value) one += kNoise * normal(random);
    innovation.covariance = 1.5 * kNoise * kNoise * Eigen::Matrix3d::Identity();
    watch.add(innovation, gain_p, gain_v, kPeriod, given);
    p += gain_p * innovation.value;
    v += gain_v * innovation.value;
  }
  const CoilWatch::Finding found = watch.most_suspect();
  EXPECT_EQ(found.coil, 3);
  EXPECT_NEAR(found.lack, kLack, 0.15);
  EXPECT_GT(found.evidence, 50);
  EXPECT_GT(found.evidence, found.next + 12);
  EXPECT_THROW(CoilWatch(0), std::invalid_argument);
}

TEST(CoilWatch, HealthyCoilsGiveNoEvidence) {
  CoilWatch watch(2);
  std::mt19937_64 random(4);
  std::normal_distribution<double> normal;
  const Eigen::Matrix3d gain = 0.3 * Eigen::Matrix3d::Identity();
  double most = 0;
  for (int n = 0; n < 5000; ++n) {
    CoilMotions given = CoilMotions::Random(3, 2) * 5e-6;
    Innovation innovation;
    for (double& one : innovation.value) one = kNoise * normal(random);
    innovation.covariance = kNoise * kNoise * Eigen::Matrix3d::Identity();
    watch.add(innovation, gain, gain, kPeriod, given);
    most = std::max(most, watch.most_suspect().evidence);
  }
  // chi^2 of one degree of freedom, two coils, some hundred independent looks: 25 is one in 1e6.
  EXPECT_LT(most, 25);
}

}  // namespace
}  // namespace vitreo::control
