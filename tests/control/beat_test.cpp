// The beat of a swimmer by the phase of its field: found among a loop's own motion, also by frames
// that are too few to show it, and nothing where there is none.
// SPDX-License-Identifier: Apache-2.0
#include "control/beat.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

namespace vitreo::control {
namespace VITREO_TEST_FILE {

constexpr double kNoise = 4.3e-6;  // m

/// rms of what is left of the innovations along the beat over the last of `count` frames.
struct Left {
  double rms = 0;
  Eigen::Vector2d found{0, 0};
};
Left left_of(double hertz, double frames, double amplitude, int count = 150) {
  Beat beat;
  std::mt19937_64 random(5);
  std::normal_distribution<double> normal;
  const Eigen::Vector3d direction(0, 0.6, 0.8);
  Left left;
  int counted = 0;
  for (int n = 0; n < count; ++n) {
    const double time = n / frames;
    const Beat::Moment moment{2 * M_PI * hertz * time, 0.5, direction};
    Eigen::Vector3d seen = amplitude * 0.5 * std::sin(moment.phase + 0.7) * direction;
    for (double& one : seen) one += kNoise * normal(random);
    const Eigen::Vector3d off = seen - beat.displacement(moment);
    beat.learn(moment, off, kNoise * kNoise * Eigen::Matrix3d::Identity());
    if (n < count / 2) continue;
    left.rms += std::pow(off.dot(direction), 2);
    ++counted;
  }
  left.rms = std::sqrt(left.rms / counted);
  left.found = beat.amplitudes();
  return left;
}

// 9 Hz by 15 frames/s looks like 6 Hz, 14 like 1.
TEST(Beat, IsFoundByItsPhaseWhateverTheFrames) {
  constexpr double kAmplitude = 150e-6;  // m/rad
  for (const double hertz : {3.0, 9.0, 12.0, 14.0}) {
    const Left left = left_of(hertz, 15, kAmplitude);
    EXPECT_LT(left.rms, 1.5 * kNoise) << hertz;
    EXPECT_NEAR(left.found[0], kAmplitude * std::cos(0.7), 8e-6) << hertz;
    EXPECT_NEAR(left.found[1], kAmplitude * std::sin(0.7), 8e-6) << hertz;
  }
}

TEST(Beat, WithoutOneTheMeasurementsStayAsTheyAre) {
  const Left left = left_of(9, 15, 0);
  EXPECT_LT(left.found.norm(), 8e-6);
  Beat beat;
  const Beat::Moment standing{0.3, 0, {1, 0, 0}};
  beat.learn(standing, {1e-3, 0, 0}, Eigen::Matrix3d::Identity() * 1e-12);
  EXPECT_EQ(beat.amplitudes(), Eigen::Vector2d(0, 0)) << "a field that stands beats nothing";
  const double nan = std::numeric_limits<double>::quiet_NaN();
  beat.learn({0.3, 0.5, {1, 0, 0}}, {nan, 0, 0}, Eigen::Matrix3d::Identity());
  EXPECT_EQ(beat.amplitudes(), Eigen::Vector2d(0, 0));
}

// Frames at each whole turn show one number of the two; an hour of it does not make the other one
// more unknown than it was at first.
TEST(Beat, OfFramesInStepWithItNothingRunsAway) {
  const Left left = left_of(15, 15, 100e-6, 54000);
  EXPECT_TRUE(left.found.allFinite());
  EXPECT_LT(left.found.norm(), 200e-6);
  EXPECT_LT(left.rms, 1.5 * kNoise);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::control
