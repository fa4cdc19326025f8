// Growth rate of a robot's departure in constant currents.
// SPDX-License-Identifier: Apache-2.0
#include "control/stability.h"

#include "control/box_allocation.h"

#include <gtest/gtest.h>

#include <stdexcept>

namespace vitreo::control {
namespace VITREO_TEST_FILE {

const Robot kRobot = coni_2mm();
const Medium kOil;

// The currents that levitate the robot at the center in a field of 20 mT.
Currents levitating(const FieldModel& field, const Eigen::Vector3d& axis) {
  const Eigen::Vector3d moment = kRobot.moment(20e-3) * axis;
  const FieldAndForce wanted{20e-3 * axis, {0, 0, kRobot.net_weight(kOil)}, {0, 0, 0}};
  return allocate_within(field.matrix({0, 0, 0}), moment, wanted, CurrentLimits::Constant(8, 12))
      .currents;
}

double time_constant(const Eigen::Vector3d& axis) {
  const FieldModel field = CoilField::octomag();
  return 1 / instability(field, kRobot, kOil, levitating(field, axis), {0, 0, 0});
}

TEST(Instability, is_ten_times_as_fast_for_a_robot_along_x_as_along_z) {
  EXPECT_NEAR(time_constant({1, 0, 0}), 4.5, 0.5);  // facts/magnetics 0.4
  EXPECT_NEAR(time_constant({0, 0, 1}), 46, 6);
}

TEST(Instability, is_how_a_robot_that_is_let_go_moves) {
  const FieldModel field = CoilField::octomag();
  const Currents currents = levitating(field, {1, 0, 0});
  const double rate = instability(field, kRobot, kOil, currents, {0, 0, 0});
  Eigen::Vector3d place(1e-6, 1e-6, 1e-6);
  const Eigen::Matrix3d mobility =
      Eigen::Vector3d(resistance(kRobot, kOil, {1, 0, 0}).diagonal().cwiseInverse()).asDiagonal();
  constexpr double kStep = 0.01;
  const auto run = [&](double seconds) {
    for (double t = 0; t < seconds; t += kStep)
      place += kStep * mobility * force_at(field, kRobot, kOil, currents, place);
    return place.norm();
  };
  run(20);  // until the fastest direction is all there is
  const double before = place.norm();
  EXPECT_NEAR(std::log(run(3) / before) / 3, rate, 0.02 * rate + 0.002);
}

TEST(ForceAt, is_the_weight_alone_without_current) {
  const FieldModel field = CoilField::octomag();
  const Eigen::Vector3d force = force_at(field, kRobot, kOil, Currents::Zero(8), {0, 0, 0});
  EXPECT_NEAR(force.z(), -kRobot.net_weight(kOil), 1e-12);
  EXPECT_EQ(instability(field, kRobot, kOil, Currents::Zero(8), {0, 0, 0}), 0);
  EXPECT_THROW(force_at(field, kRobot, kOil, Currents::Zero(7), {0, 0, 0}), std::invalid_argument);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::control
