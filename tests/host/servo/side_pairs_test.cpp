// Pairs of frames of cameras that are not triggered together.
// SPDX-License-Identifier: Apache-2.0
#include "host/servo/observers.h"

#include <gtest/gtest.h>

namespace vitreo {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;

struct SidePairs : ::testing::Test {
  /// A robot that moves at 1 mm/s along x, seen every 20 ms from 7 ms on.
  void see(int from, int to, int blind = -1) {
    for (int i = from; i < to; ++i) {
      Frame frame;
      frame.exposed = 7ms + i * 20ms;
      if (i == blind) {
        buffer.add(frame, std::nullopt);
        continue;
      }
      SideObservation seen;
      seen.exposed = frame.exposed;
      seen.position = {to_seconds(frame.exposed) * 1e-3, 2e-3};
      seen.covariance = 1e-12 * Eigen::Matrix2d::Identity();
      buffer.add(frame, seen);
    }
  }
  std::unique_ptr<Clock> clock = virtual_clock();
  SideObservationBuffer buffer{*clock, 20ms};
};

TEST_F(SidePairs, OfCamerasInStepAreTheFrameOfThatMoment) {
  see(0, 5);
  const auto view = buffer.at(47ms, 50ms);
  ASSERT_TRUE(view);
  EXPECT_EQ(view->skew, 0ms);
  EXPECT_DOUBLE_EQ(view->position.x(), 47e-6);
  EXPECT_DOUBLE_EQ(view->covariance(0, 0), 1e-12);
}

TEST_F(SidePairs, OfFreeRunningCamerasAreWhereTheRobotWasBetweenTheFrames) {
  see(0, 5);
  const auto view = buffer.at(52ms, 60ms);
  ASSERT_TRUE(view);
  EXPECT_EQ(view->skew, -5ms);
  EXPECT_NEAR(view->position.x(), 52e-6, 1e-12);
  EXPECT_NEAR(view->covariance(0, 0), (0.75 * 0.75 + 0.25 * 0.25) * 1e-12, 1e-18);
}

TEST_F(SidePairs, WhoseLaterFrameDoesNotComeInTimeGoOnAsBefore) {
  see(0, 3);  // the last at 47 ms
  const auto view = buffer.at(60ms, 62ms);
  ASSERT_TRUE(view);
  EXPECT_EQ(view->skew, -13ms);
  EXPECT_NEAR(view->position.x(), 60e-6, 1e-12);
  EXPECT_GT(view->covariance(0, 0), 1e-12) << "further from what was measured";
  EXPECT_EQ(clock->now(), 62ms) << "it waits no longer than it may";
}

TEST_F(SidePairs, WithoutTheRobotInAFrameUseTheFramesBesideIt) {
  see(0, 5, 2);
  const auto view = buffer.at(52ms, 60ms);
  ASSERT_TRUE(view);
  EXPECT_NEAR(view->position.x(), 52e-6, 1e-12);
}

TEST_F(SidePairs, ThatAreTooOldAreNone) {
  see(0, 3);
  EXPECT_FALSE(buffer.at(100ms, 101ms));
  EXPECT_FALSE(SideObservationBuffer(*clock, 20ms).at(100ms, 102ms));
}

TEST_F(SidePairs, BeforeTheFirstFrameAreNone) {
  see(0, 2);
  EXPECT_FALSE(buffer.at(3ms, 200ms));
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
