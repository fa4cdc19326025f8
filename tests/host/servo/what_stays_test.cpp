// What stays wrong of a view: it is stated beside the noise, goes into the weights of two cameras,
// and is not averaged away.
// SPDX-License-Identifier: Apache-2.0
#include "host/servo/localizer.h"

#include <gtest/gtest.h>

#include <cmath>

namespace vitreo {
namespace VITREO_TEST_FILE {

constexpr double kUm = 1e-6;

/// A robot 1 % larger than believed, which looks 150 um nearer to the top camera.
Observation seen_from_above() {
  Observation top;
  top.position = Eigen::Vector3d(0, 0, 150 * kUm);
  const Eigen::Vector3d size(0, 0, 150 * kUm);
  top.systematic = size * size.transpose();
  top.covariance = std::pow(4 * kUm, 2) * Eigen::Matrix3d::Identity() + top.systematic;
  return top;
}

SideObservation seen_from_the_side() {
  SideObservation side;
  side.position = {0, 0};
  side.systematic = std::pow(10 * kUm, 2) * Eigen::Matrix2d::Identity();
  side.covariance = std::pow(3 * kUm, 2) * Eigen::Matrix2d::Identity() + side.systematic;
  return side;
}

TEST(WhatStays, ALoopReckonsWithTheNoiseAloneAndTheRecordWithAll) {
  const Observation top = seen_from_above();
  EXPECT_NEAR(std::sqrt(top.noise()(2, 2)), 4 * kUm, 1e-3 * kUm);
  EXPECT_GT(std::sqrt(top.covariance(2, 2)), 150 * kUm);
}

TEST(WhatStays, TwoCamerasAreNotDrawnOffByARobotOfAnotherSize) {
  Observation both = seen_from_above();
  join_side(both, seen_from_the_side());
  EXPECT_LT(std::abs(both.position->z()), 2 * kUm) << "45 um where the size is in no covariance";
  const double stated = std::sqrt(both.covariance(2, 2));
  EXPECT_GT(stated, 10 * kUm) << "what stays of the side camera is not averaged away";
  EXPECT_LT(stated, 12 * kUm);
  // Both parts are covariances, and of the noise there is no more than of one camera.
  EXPECT_GE(both.noise().diagonal().minCoeff(), 0);
  EXPECT_LT(std::sqrt(both.noise()(2, 2)), 4 * kUm);
}

TEST(WhatStays, HowFarApartBothCamerasSeeItCountsAllThatIsUnknownOfEither) {
  Observation near = seen_from_above(), far = seen_from_above();
  EXPECT_EQ(near.apart, 0) << "alone";
  join_side(near, seen_from_the_side());
  EXPECT_NEAR(near.apart, 1, 0.01) << "150 um in depth, which its size leaves open";
  SideObservation aside = seen_from_the_side();
  aside.position.x() = 150 * kUm;
  join_side(far, aside);
  // Across the line of sight: 4 um of one, 3 and 10 of the other.
  EXPECT_NEAR(far.apart, std::hypot(1, 150 / std::sqrt(4 * 4 + 3 * 3 + 10 * 10)), 0.05);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
