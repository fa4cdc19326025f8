// Standstill: a robot that is told to go and is seen in one place, by its places and what it was
// told.
// SPDX-License-Identifier: Apache-2.0
#include "control/standstill.h"

#include <gtest/gtest.h>

#include <random>

namespace vitreo::control {
namespace VITREO_TEST_FILE {

constexpr double kFrame = 1 / 15.0;  // s
constexpr double kNoise = 4.3e-6;    // m

/// s, at which it is first said to stand; -1: never. Told so fast, it goes so fast, m/s.
double said_to_stand(double told, double goes, double sigma = kNoise) {
  Standstill watch;
  std::mt19937_64 random(4);
  std::normal_distribution<double> normal(0, sigma);
  for (double time = 0; time < 15; time += kFrame) {
    const Eigen::Vector3d place(1e-3 + goes * time + normal(random), normal(random),
                                -2e-3 + normal(random));
    watch.add(time, place, sigma, kFrame * Eigen::Vector3d(told, 0, 0));
    if (watch.stands()) return time;
  }
  return -1;
}

TEST(Standstill, OneThatIsToldToGoAndIsSeenInOnePlaceStands) {
  const double fast = said_to_stand(0.5e-3, 0);
  EXPECT_GE(fast, 1.25);
  EXPECT_LT(fast, 1.4);
  EXPECT_NEAR(said_to_stand(0.1e-3, 0), 4.0, 0.2) << "0.4 mm were told then";
  EXPECT_GT(said_to_stand(0.2e-3, 0, 80e-6), 3.9) << "as much as its noise wants";
}

TEST(Standstill, OneThatGoesOrDriftsOrIsToldNothingDoesNot) {
  EXPECT_EQ(said_to_stand(0.5e-3, 0.5e-3), -1);
  EXPECT_EQ(said_to_stand(0.5e-3, 0.1e-3), -1) << "a fifth of it";
  EXPECT_EQ(said_to_stand(0.5e-3, -0.06e-3), -1) << "it sinks, for the field has lost it";
  EXPECT_EQ(said_to_stand(0.01e-3, 0), -1);
}

TEST(Standstill, WhatCancelsIsNotToldAndAResetForgets) {
  Standstill watch;
  for (int k = 0; k < 200; ++k)
    watch.add(k * kFrame, {0, 0, 0}, kNoise, {k % 2 == 0 ? 0.2e-3 : -0.2e-3, 0, 0});
  EXPECT_FALSE(watch.stands());
  for (int k = 200; k < 230; ++k) watch.add(k * kFrame, {0, 0, 0}, kNoise, {50e-6, 0, 0});
  EXPECT_TRUE(watch.stands());
  watch.reset();
  EXPECT_FALSE(watch.stands());
  for (int k = 230; k < 237; ++k) watch.add(k * kFrame, {0, 0, 0}, kNoise, {50e-6, 0, 0});
  EXPECT_FALSE(watch.stands()) << "what was told before it";
  watch.add(0, {0, 0, 0}, kNoise, {50e-6, 0, 0});
  EXPECT_FALSE(watch.stands()) << "a time that runs backwards";
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::control
