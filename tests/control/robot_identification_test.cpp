// Identification of the robot: motions of another simulation, stepped by hand, are found again,
// with sigmas that hold.
// SPDX-License-Identifier: Apache-2.0
#include "control/robot_identification.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <stdexcept>

namespace vitreo::control {
namespace VITREO_TEST_FILE {

const Eigen::Vector3d kAlongX(1, 0, 0);
const Eigen::Vector3d kDown(0, 0, -1);

struct Truth {
  double delay = 0.06;
  double lag = 0.0106;
  double gain = 0.8;
  double drift = 40e-6;  // m/s
  double slope = 0.15;   // 1/s
  double noise = 4.3e-6;
};

// Steps of 0.1 ms: delay, first-order lag, then p' = drift + slope p + gain u.
DrivenMotion driven(const Truth& truth, std::uint64_t seed) {
  constexpr double kStep = 1e-4;
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  DrivenMotion motion;
  motion.lag = truth.lag;
  double p = 0, behind = 0;
  for (int step = 0; step < 160000; ++step) {
    const double time = step * kStep;
    if (step % 667 == 0) {
      const double u = std::fmod(time, 2.0) < 1 ? 0.8e-3 : -0.8e-3;
      motion.commanded.push_back({time, u * kAlongX});
      motion.measured.push_back({time, (p + truth.noise * normal(random)) * kAlongX});
    }
    double acting = motion.commanded.front().value.x();
    for (auto one = motion.commanded.rbegin(); one != motion.commanded.rend(); ++one)
      if (one->time + truth.delay <= time) {
        acting = one->value.x();
        break;
      }
    behind += (acting - behind) * kStep / truth.lag;
    p += kStep * (truth.drift + truth.slope * p + truth.gain * behind);
  }
  return motion;
}

TEST(RobotIdentification, AResponseIsFoundWithinWhatItStates) {
  const Truth truth;
  double delays = 0, gains = 0;
  constexpr int kRuns = 12;
  for (std::uint64_t seed = 1; seed <= kRuns; ++seed) {
    const IdentifiedResponse found = identify_response(driven(truth, seed), kAlongX);
    EXPECT_NEAR(found.delay.value, truth.delay, 2e-3) << "the goal is 5 ms";
    EXPECT_NEAR(found.gain.value, truth.gain, 0.01 * truth.gain);
    EXPECT_NEAR(found.residual, truth.noise, 0.3 * truth.noise);
    delays += std::pow((found.delay.value - truth.delay) / found.delay.sigma, 2) / kRuns;
    gains += std::pow((found.gain.value - truth.gain) / found.gain.sigma, 2) / kRuns;
  }
  // chi^2 with 12 degrees of freedom over 12: 0.2 to 2.7 is where 99.9 % are.
  EXPECT_LT(delays, 2.7);
  EXPECT_LT(gains, 2.7);
  EXPECT_GT(gains, 0.2);
}

Fall fall(double speed, double delay, double noise, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  Fall one;
  one.off = 0.5;
  one.on = 1;
  const double lag = 5e-3;
  for (int k = 0; k < 18; ++k) {
    const double time = k / 15.0 + 0.01 * static_cast<double>(seed % 5);
    const double since = time - one.off - delay;
    const double fallen = since > 0 ? since - lag * (1 - std::exp(-since / lag)) : 0;
    one.measured.push_back(
        {time, Eigen::Vector3d(0, 0, 1e-3 - speed * fallen) +
                   noise * Eigen::Vector3d(normal(random), normal(random), normal(random))});
  }
  return one;
}

TEST(RobotIdentification, FallsGiveSpeedAndDelayWithoutAnyModelOfTheField) {
  std::vector<Fall> falls;
  for (std::uint64_t seed = 1; seed <= 5; ++seed) falls.push_back(fall(1.6e-3, 0.06, 4.3e-6, seed));
  const IdentifiedFall found = identify_fall(falls, kDown, 5e-3);
  EXPECT_NEAR(found.speed.value, 1.6e-3, 0.02 * 1.6e-3);
  EXPECT_NEAR(found.delay.value, 0.06, 4e-3);
  EXPECT_LT(std::abs(found.speed.value - 1.6e-3), 4 * found.speed.sigma);
  EXPECT_LT(found.speed.sigma, 0.02 * 1.6e-3);
  EXPECT_LT(std::abs(found.delay.value - 0.06), 4 * found.delay.sigma);
}

TEST(RobotIdentification, WhatCannotBeToldIsRefusedByName) {
  DrivenMotion steady = driven({}, 1);
  for (TimedVector& one : steady.commanded) one.value = 1e-6 * kAlongX;
  EXPECT_THROW(identify_response(steady, kAlongX), std::domain_error)
      << "a command that does not change is no excitation";
  DrivenMotion motion = driven({}, 1);
  EXPECT_THROW(identify_response(motion, {1, 1, 0}), std::invalid_argument);
  std::swap(motion.measured[3], motion.measured[4]);
  EXPECT_THROW(identify_response(motion, kAlongX), std::invalid_argument);
  EXPECT_THROW(identify_fall({}, kDown, 0), std::invalid_argument);
  Fall early = fall(1.6e-3, 0.06, 0, 1);
  early.on = early.off + 0.01;
  EXPECT_THROW(identify_fall({early}, kDown, 0), std::domain_error);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::control
