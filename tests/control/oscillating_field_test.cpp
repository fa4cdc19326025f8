// SPDX-License-Identifier: Apache-2.0
#include "control/flexible_tail.h"
#include "control/robots.h"
#include "control/rotating_field.h"
#include "control/swim_law.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <vector>

namespace vitreo::control {
namespace VITREO_TEST_FILE {

constexpr double kTurn = 2 * std::numbers::pi;

Rotation swinging(double frequency) {
  Rotation rotation;
  rotation.axis = Eigen::Vector3d(1, 2, -1).normalized();
  rotation.first = rotation.axis.unitOrthogonal();
  rotation.field = 10e-3;
  rotation.frequency = frequency;
  rotation.swing = 0.7;
  return rotation;
}

TEST(OscillatingField, BehindTheCoilsItSwingsByTheAngleThatIsWanted) {
  const Rotation rotation = swinging(6);
  const double lag = 10.6e-3, step = 20e-6;
  Eigen::Vector3d flowing = rotation.field * std::cos(0.7) * rotation.axis;
  double widest = 0, largest = 0;
  for (double time = 0; time < 1; time += step) {
    flowing += step / lag * (commanded_field(rotation, kTurn * 6 * time, lag, 0) - flowing);
    if (time < 0.5) continue;
    const Eigen::Vector3d wanted =
        rotation.field * (std::cos(0.7) * rotation.axis +
                          std::sin(0.7) * std::sin(kTurn * 6 * time) * rotation.first);
    ASSERT_LT((flowing - wanted).norm(), 0.01 * rotation.field) << time;
    widest = std::max(widest, std::acos(flowing.normalized().dot(rotation.axis)));
    largest = std::max(largest, flowing.norm());
  }
  EXPECT_NEAR(widest, 0.7, 0.01);
  EXPECT_NEAR(largest, rotation.field, 0.01 * rotation.field);
}

// By all set-points of a beat: none of the limits is passed, and one of them is reached.
TEST(OscillatingField, WhatOfItTheCoilsReachIsWhatItsSetPointsSay) {
  const FieldCurrents currents = uniform_field_currents(
      CoilField::octomag().matrix({1e-3, 0, 2e-3}), CurrentLimits::Constant(8, 12));
  for (const double frequency : {0.0, 4.0, 12.0, 60.0})
    for (const double most : {1.0, 4.0}) {
      RotationLimits limits;
      limits.currents = CurrentLimits::Constant(8, most);
      limits.total = 5 * most;
      limits.slew = 600;
      limits.update = 0;
      Rotation rotation = swinging(frequency);
      rotation.field *= reachable_part(currents, rotation, limits);
      double peak = 0, total = 0, rate = 0;
      Currents last;
      const int steps = 4000;
      for (int k = 0; k <= steps; ++k) {
        const Currents now = currents * commanded_field(rotation, kTurn * k / steps, limits.lag, 0);
        peak = std::max(peak, now.cwiseAbs().maxCoeff());
        total = std::max(total, now.cwiseAbs().sum());
        if (k > 0) rate = std::max(rate, (now - last).cwiseAbs().maxCoeff() * frequency * steps);
        last = now;
      }
      const double nearest = std::max({peak / most, total / limits.total, rate / limits.slew,
                                       rotation.field / swinging(1).field});
      EXPECT_NEAR(nearest, 1, 0.02) << frequency << " Hz, " << most << " A";
    }
}

TEST(FlexibleTail, ItsDragIsTheSumOverItsPieces) {
  const FlexibleTail tail;
  const TailDrag drag = tail_drag(tail, 0.485);
  const int pieces = 4000;
  double across = drag.head, coupling = drag.head * tail.head_lever(),
         turning = drag.head * tail.head_lever() * tail.head_lever() + drag.head_spin;
  for (int k = 0; k < pieces; ++k) {
    const double piece = tail.length / pieces;
    const double lever = tail.head_lever() - tail.head_radius - (k + 0.5) * piece;
    across += drag.normal * piece;
    coupling += drag.normal * piece * lever;
    turning += drag.normal * piece * lever * lever;
  }
  EXPECT_NEAR(drag.across / across, 1, 1e-6);
  EXPECT_LT(std::abs(coupling), 1e-6 * drag.across * tail.length) << "its center of reaction";
  EXPECT_NEAR(drag.turning / turning, 1, 1e-6);
}

// Of a slender body Perrin's spheroid has the same (control::resistance).
TEST(FlexibleTail, ItsCoefficientsAreASlenderSpheroids) {
  Robot rod = robot_named("ndfeb_cylinder_1mm");
  const FlexibleTail tail;
  rod.semi_axis = tail.length / 2;
  rod.semi_radius = tail.radius;
  rod.solid_volume = 1e-13;
  const Medium oil;
  const Eigen::Matrix3d exact = resistance(rod, oil, {1, 0, 0});
  const TailDrag drag = tail_drag(tail, oil.dynamic_viscosity());
  EXPECT_NEAR(drag.tangential * tail.length / exact(0, 0), 1, 2e-3);
  EXPECT_NEAR(drag.normal * tail.length / exact(1, 1), 1, 2e-3);
}

TEST(FlexibleTail, SpermNumberGoesWithTheFourthRootOfTheFrequency) {
  const FlexibleTail tail;
  const double one = sperm_number(tail, 0.485, 1);
  EXPECT_NEAR(sperm_number(tail, 0.485, 16) / one, 2, 1e-9);
  // By hand: zeta_n = 4 pi 0.485 / (ln 92 + 1/2) = 1.2136, A = 0.3e9 pi / 4 (25e-6)^4 = 9.204e-11.
  EXPECT_NEAR(one, 2.3e-3 * std::pow(kTurn * 1.2136 / 9.204e-11, 0.25), 1e-3);
}

TEST(SpeedCurve, GoesThereAndBackOnItsRisingPart) {
  const SpeedCurve curve({{1, 20e-6}, {2, 60e-6}, {3, 55e-6}, {4, 100e-6}, {6, 80e-6}});
  EXPECT_EQ(curve.fastest(), 4) << "what falls behind the best is of no use";
  EXPECT_NEAR(curve.speed(3), 80e-6, 1e-9) << "a point below the one before it is noise";
  for (const double speed : {20e-6, 41e-6, 77e-6, 100e-6})
    EXPECT_NEAR(curve.speed(curve.frequency(speed)), speed, 1e-12);
  EXPECT_EQ(curve.frequency(1), 4);
  EXPECT_EQ(curve.frequency(0), 1);
  EXPECT_THROW(SpeedCurve({{1, -20e-6}, {2, 0}}), std::invalid_argument);
  EXPECT_THROW(SpeedCurve({{1, 20e-6}, {1, 30e-6}}), std::invalid_argument);
  EXPECT_THROW(SpeedCurve(std::vector<SpeedCurve::Point>{}), std::invalid_argument);
}

TEST(SpeedCurve, OfOneFrequencyHasOneSpeed) {
  const SpeedCurve curve({{9, 140e-6}, {12, 130e-6}});
  EXPECT_EQ(curve.fastest(), 9);
  EXPECT_EQ(curve.lowest(), 9);
  EXPECT_EQ(curve.speed(12), 140e-6);
  EXPECT_EQ(curve.frequency(70e-6), 9);
  EXPECT_EQ(curve.slowest_speed(), 140e-6);
}

class Beating : public ::testing::Test {
 protected:
  SwimCommand swim_at(const Eigen::Vector3d& velocity, const Eigen::Vector3d& before) {
    SwimSettings settings;
    settings.mode = RotatingMode::oscillating;
    settings.frequency = 20;
    settings.speeds = &curve_;
    return swim(settings, velocity, Eigen::Vector3d::UnitZ(), before, 1 / 15.0);
  }
  const SpeedCurve curve_{{{1, 20e-6}, {4, 100e-6}}};
};

TEST_F(Beating, GoesAtTheFrequencyOfItsSpeed) {
  const SwimCommand command = swim_at({60e-6, 0, 0}, {1, 0, 0});
  EXPECT_NEAR(command.frequency, 2.5, 1e-9);
  EXPECT_NEAR(command.swing, 0.7, 1e-9);
  EXPECT_NEAR(command.velocity.x(), 60e-6, 1e-12);
  EXPECT_NEAR(swim_at({1e-3, 0, 0}, {1, 0, 0}).velocity.x(), 100e-6, 1e-12)
      << "no faster than it can";
}

TEST_F(Beating, SlowerThanTheSlowestTheFieldSwingsLess) {
  const SwimCommand command = swim_at({5e-6 + 1e-12, 0, 0}, {1, 0, 0});
  EXPECT_EQ(command.frequency, 1);
  EXPECT_NEAR(std::sin(command.swing) / std::sin(0.7), 0.5, 1e-6);
  EXPECT_NEAR(swim_at({0, 0, 0}, {1, 0, 0}).swing, 0, 1e-12);
}

TEST_F(Beating, NeverBackwardsButRound) {
  Eigen::Vector3d axis(1, 0, 0);
  for (int k = 0; k < 60; ++k) {
    const SwimCommand command = swim_at({-60e-6, 0, 0}, axis);
    EXPECT_NEAR(command.axis.norm(), 1, 1e-9);
    EXPECT_GE(command.velocity.dot(command.axis), 0);
    EXPECT_GE(command.frequency, 0);
    axis = command.axis;
  }
  EXPECT_NEAR(axis.x(), -1, 1e-9);
  EXPECT_NEAR(swim_at({-60e-6, 0, 0}, axis).velocity.x(), -60e-6, 1e-12);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::control
