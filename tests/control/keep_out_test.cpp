// Velocities that keep a margin to the walls.
// SPDX-License-Identifier: Apache-2.0
#include "control/keep_out.h"

#include "control/robots.h"

#include <gtest/gtest.h>

#include <cmath>
#include <stdexcept>

namespace vitreo::control {
namespace VITREO_TEST_FILE {

const KeepOut kSettings;
const BodySurface kBody = surface_of(coni_2mm());

Clearance lying_at(double height) {
  UncertainPose pose;
  pose.position = {0, 0, -5e-3 + height};
  pose.axis = {1, 0, 0};
  pose.axis_sigma = 0;
  return clearance(kBody, {}, pose);
}

TEST(KeepOut, FarFromTheWallsAndAwayFromThemNothingIsChanged) {
  const Eigen::Vector3d down(0.3e-3, 0, -1e-3);
  EXPECT_FALSE(keep_out(kSettings, lying_at(5e-3), down).limited);
  EXPECT_EQ(keep_out(kSettings, lying_at(5e-3), down).velocity, down);
  EXPECT_FALSE(keep_out(kSettings, lying_at(0.75e-3), -down).limited);
}

TEST(KeepOut, NearTheMarginOnlyTheWayToTheWallIsTakenOff) {
  const KeptOut kept = keep_out(kSettings, lying_at(0.8e-3), {0.3e-3, 0, -1e-3});
  EXPECT_TRUE(kept.limited);
  EXPECT_EQ(kept.velocity.x(), 0.3e-3) << "along the wall it may go on";
  EXPECT_NEAR(kept.velocity.z(), -kSettings.rate * 0.1e-3, 1e-9)
      << "0.3 mm left, 0.1 over the margin";
}

TEST(KeepOut, InsideOfTheMarginItLeadsBackNoFasterThanAllowed) {
  EXPECT_NEAR(keep_out(kSettings, lying_at(0.6e-3), {0, 0, 0}).velocity.z(),
              kSettings.rate * 0.1e-3, 1e-9);
  EXPECT_NEAR(keep_out(kSettings, lying_at(0.1e-3), {0, 0, 0}).velocity.z(), kSettings.max_retreat,
              1e-9);
}

// d/dt (b - m) = -rate (b - m): followed exactly, the margin is reached and not crossed.
TEST(KeepOut, ADriveAgainstTheWallEndsAtTheMargin) {
  double height = 2e-3;
  for (int k = 0; k < 400; ++k)
    height += keep_out(kSettings, lying_at(height), {0, 0, -5e-3}).velocity.z() / 15;
  EXPECT_NEAR(height, 0.7e-3, 1e-6);
}

TEST(KeepOut, TheLensIsAWallToo) {
  EXPECT_LE(keep_out(kSettings, lying_at(14.8e-3), {0, 0, 1e-3}).velocity.z(), 1e-9);
}

TEST(KeepOut, NamesTheSettingThatIsWrong) {
  KeepOut settings;
  settings.rate = 0;
  EXPECT_THROW(settings.check(), std::invalid_argument);
  settings = {};
  settings.margin = NAN;
  EXPECT_THROW(settings.check(), std::invalid_argument);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::control
