// SPDX-License-Identifier: Apache-2.0
#include "control/rotating_field.h"

#include "control/field_model.h"
#include "control/rolling.h"
#include "control/swim_law.h"

#include <Eigen/Geometry>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace vitreo::control {
namespace VITREO_TEST_FILE {

constexpr double kTurn = 2 * std::numbers::pi;
constexpr double kLag = 1 / (kTurn * 15);  // s: coils of 15 Hz

Rotation about(const Eigen::Vector3d& axis, double frequency, double field = 2e-3) {
  return {axis, axis.unitOrthogonal(), frequency, field};
}

/// The reference: set-points held for `hold` behind a first-order lag, integrated in steps of 10
/// us. Returns the least and the largest magnitude of the field over the third and fourth second.
std::pair<double, double> magnitudes(const Rotation& rotation, double hold) {
  const double h = 1e-5;
  Eigen::Vector3d b = Eigen::Vector3d::Zero(), set = b;
  double low = 1e9, high = 0, next = 0;
  for (double t = 0; t < 4; t += h) {
    if (t >= next) {
      set = commanded_field(rotation, kTurn * rotation.frequency * (t + hold / 2), kLag, hold);
      next += hold;
    }
    b += h / kLag * (set - b);
    if (t < 2) continue;
    low = std::min(low, b.norm());
    high = std::max(high, b.norm());
  }
  return {low, high};
}

TEST(RotatingField, IsRoundBehindTheLagOfTheCoils) {
  const auto [low, high] = magnitudes(about(Eigen::Vector3d::UnitX(), 50), 1e-3);
  EXPECT_NEAR(low / 2e-3, 1, 0.01);
  EXPECT_NEAR(high / 2e-3, 1, 0.01);
}

// At the fewest set-points a turn that are allowed.
TEST(RotatingField, IsUnevenByATenthAtMostWithTheFewestSetPoints) {
  const double hold = 11e-3, fastest = 1 / (kSetPointsPerTurn * hold);
  for (const double frequency : {2.0, 7.0, fastest}) {
    const auto [low, high] = magnitudes(about(Eigen::Vector3d::UnitY(), frequency), hold);
    EXPECT_GT(low / 2e-3, 0.9) << frequency;
    EXPECT_LT(high / 2e-3, 1.1) << frequency;
  }
}

TEST(RotatingField, HasNoGradientAndIsExactWithEightCoils) {
  const FieldModel model(CoilField::octomag());
  const Eigen::Vector3d place(2e-3, -1e-3, 1e-3), wanted(1e-3, 2e-3, -0.5e-3);
  const FieldMatrix matrix = model.matrix(place);
  const FieldCurrents currents = uniform_field_currents(matrix, CurrentLimits::Constant(8, 12));
  const FieldGradient made = matrix * (currents * wanted);
  EXPECT_NEAR((made.head<3>() - wanted).norm() / wanted.norm(), 0, 1e-3);
  EXPECT_LT(made.tail<5>().norm() * 20e-3, 1e-3 * wanted.norm());
}

TEST(RotatingField, LeavesDeadCoilsAloneAndKeepsTheField) {
  const FieldMatrix matrix = FieldModel(CoilField::octomag()).matrix(Eigen::Vector3d::Zero());
  CurrentLimits limits = CurrentLimits::Constant(8, 12);
  limits[2] = 0;
  const FieldCurrents currents = uniform_field_currents(matrix, limits);
  EXPECT_EQ(currents.row(2).norm(), 0);
  const Eigen::Vector3d wanted(0, 0, 2e-3);
  const FieldGradient made = matrix * (currents * wanted);
  EXPECT_NEAR((made.head<3>() - wanted).norm() / wanted.norm(), 0, 0.02);
}

TEST(RotatingField, IsCutToWhatCurrentsTotalAndSlewAllow) {
  const FieldCurrents currents =
      uniform_field_currents(FieldModel(CoilField::octomag()).matrix(Eigen::Vector3d::Zero()),
                             CurrentLimits::Constant(8, 12));
  RotationLimits limits;
  const Rotation strong = about(Eigen::Vector3d::UnitX(), 10, 40e-3);
  const double part = reachable_part(currents, strong, limits);
  EXPECT_LT(part, 1);
  // Independently: the largest current, total and rate over a turn, of what is commanded.
  double most = 0, total = 0, rate = 0;
  Currents before;
  Rotation cut = strong;
  cut.field *= part;
  for (int k = 0; k <= 3600; ++k) {
    const Currents now =
        currents * commanded_field(cut, kTurn * k / 3600, limits.lag, limits.update);
    most = std::max(most, now.cwiseAbs().maxCoeff());
    total = std::max(total, now.cwiseAbs().sum());
    if (k > 0) rate = std::max(rate, (now - before).cwiseAbs().maxCoeff() * 36000);
    before = now;
  }
  EXPECT_LE(most, 12 * 1.001);
  EXPECT_LE(total, 60 * 1.02);  // sampled each 15 degrees
  EXPECT_LE(rate, 2000 * 1.001);
  EXPECT_GT(std::max({most / 12, total / 60, rate / 2000}), 0.98);  // and no more than needed
}

// Of an amplifier on a USB of 90 updates/s 15 Hz; of one of 500/s the 50 Hz and more, at 2 mT.
TEST(RotatingField, FastestIsOfTheUpdatesOrOfTheLimits) {
  const FieldCurrents currents =
      uniform_field_currents(FieldModel(CoilField::octomag()).matrix(Eigen::Vector3d::Zero()),
                             CurrentLimits::Constant(8, 12));
  RotationLimits usb, quick;
  usb.update = 11e-3;
  quick.update = 2e-3;
  const Rotation weak = about(Eigen::Vector3d::UnitX(), 0, 2e-3);
  EXPECT_NEAR(fastest(currents, weak, usb), 1 / (6 * 11e-3), 1e-9);
  EXPECT_GT(fastest(currents, weak, quick), 50);
  const Rotation strong = about(Eigen::Vector3d::UnitX(), 0, 20e-3);
  const double limit = fastest(currents, strong, quick);
  EXPECT_LT(limit, fastest(currents, weak, quick));
  Rotation at = strong;
  at.frequency = 0.99 * limit;
  EXPECT_EQ(reachable_part(currents, at, quick), 1);
  at.frequency = 1.01 * limit;
  EXPECT_LT(reachable_part(currents, at, quick), 1);
}

TEST(RotatingField, TurnsToAnotherAxisWithoutALeapOfThePhase) {
  Rotation rotation = about(Eigen::Vector3d::UnitX(), 5);
  for (int k = 1; k <= 100; ++k) {
    const Eigen::Vector3d before = commanded_field(rotation, 1, 0, 0);
    rotation.turn_to(Eigen::Vector3d(std::cos(k * 0.01), std::sin(k * 0.01), 0.2).normalized());
    EXPECT_LT((commanded_field(rotation, 1, 0, 0) - before).norm(), 0.25 * rotation.field);
    EXPECT_NEAR(rotation.first.dot(rotation.axis), 0, 1e-12);
  }
}

TEST(SwimLaw, SwimsAlongTheVelocityByTheNearerEnd) {
  SwimSettings settings;
  const Eigen::Vector3d up = Eigen::Vector3d::UnitZ();
  const SwimCommand forwards = swim(settings, {1e-3, 0, 0}, up, {1, 0, 0}, 0.067);
  EXPECT_NEAR(forwards.frequency, 1e-3 / (kTurn * settings.advance), 1e-9);
  const SwimCommand back = swim(settings, {-1e-3, 0, 0}, up, {1, 0, 0}, 0.067);
  EXPECT_NEAR(back.axis.x(), 1, 1e-12);  // it does not turn round
  EXPECT_NEAR(back.frequency, -forwards.frequency, 1e-9);
  settings.advance *= -1;  // of a left-handed helix
  EXPECT_NEAR(swim(settings, {1e-3, 0, 0}, up, {1, 0, 0}, 0.067).frequency, -forwards.frequency,
              1e-9);
}

TEST(SwimLaw, TurnsAtItsRateAndIsNoFasterThanItsFrequency) {
  SwimSettings settings;
  settings.turn_rate = 2;
  const SwimCommand turning =
      swim(settings, {0, 1e-3, 0}, Eigen::Vector3d::UnitZ(), {1, 0, 0}, 0.1);
  EXPECT_NEAR(std::acos(turning.axis.x()), 0.2, 1e-9);
  // Only what of the velocity lies along the axis.
  EXPECT_NEAR(turning.velocity.norm(), 1e-3 * std::sin(0.2), 1e-9);
  const SwimCommand fast = swim(settings, {1, 0, 0}, Eigen::Vector3d::UnitZ(), {1, 0, 0}, 0.1);
  EXPECT_NEAR(fast.frequency, settings.frequency, 1e-12);
  EXPECT_NEAR(fast.velocity.x(), kTurn * settings.frequency * settings.advance, 1e-12);
  EXPECT_EQ(
      swim(settings, Eigen::Vector3d::Zero(), Eigen::Vector3d::UnitZ(), {1, 0, 0}, 0.1).frequency,
      0);
}

// v = w x (R n): the upper side of what rolls goes ahead.
TEST(SwimLaw, RollsOverTheWall) {
  SwimSettings settings;
  settings.mode = RotatingMode::roller;
  settings.advance = 0.25e-3;
  settings.turn_rate = 100;
  const Eigen::Vector3d normal = Eigen::Vector3d(0.2, 0, 1).normalized();
  const SwimCommand rolling =
      swim(settings, {1e-3, 0.5e-3, -2e-3}, normal, Eigen::Vector3d::UnitY(), 0.1);
  const Eigen::Vector3d rate = kTurn * rolling.frequency * rolling.axis;
  EXPECT_LT((rate.cross(settings.advance * normal) - rolling.velocity).norm(), 1e-12);
  EXPECT_NEAR(rolling.velocity.dot(normal), 0, 1e-15);
  EXPECT_GT(rolling.velocity.x(), 0);
  EXPECT_GT(rolling.velocity.y(), 0);
}

// The two forms meet; at a gap of nothing lubrication alone would give a quarter (Goldman et al.).
TEST(FluidRolling, FallsWithTheGapAndMeetsWhereTheFormsDo) {
  EXPECT_NEAR(fluid_rolling(1, 1.0999) / fluid_rolling(1, 1.1001), 1, 0.05);
  EXPECT_NEAR(fluid_rolling(1, 1.001), 0.144, 1e-3);
  EXPECT_EQ(fluid_rolling(1, 1.0), fluid_rolling(1, 1.001));
  double before = 0.25;
  for (double distance = 1.001; distance < 5; distance *= 1.05) {
    const double now = fluid_rolling(1, distance);
    EXPECT_LT(now, before * 1.05);
    EXPECT_GT(now, 0);
    before = now;
  }
  EXPECT_LT(fluid_rolling(0.25e-3, 2.5e-3), 1e-4);
  EXPECT_THROW(fluid_rolling(0, 1), std::invalid_argument);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::control
