// Servo controller, positions to currents: laws, limits, dead coils, and measurements that are no
// use.
// SPDX-License-Identifier: Apache-2.0
#include "host/servo/servo_controller.h"

#include "control/multipole_field.h"
#include "control/robots.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <stdexcept>
#include <string>

namespace vitreo {
namespace VITREO_TEST_FILE {

RigModel model() {
  RigModel model;
  model.robot = control::coni_2mm();
  return model;
}

ControllerSettings settings(ControlLaw law) {
  ControllerSettings settings;
  settings.law = law;
  return settings;
}

control::PositionMeasurement at(double time, const Eigen::Vector3d& place) {
  return {time, place, 16e-12 * Eigen::Matrix3d::Identity()};
}

ReferencePath hold(const Eigen::Vector3d& place) {
  return {control::Trajectory::hold_at(place), 0};
}

// What currents do to the robot of the model, weight included.
Eigen::Vector3d force_of(const RigModel& model, const control::Currents& currents,
                         const Eigen::Vector3d& place) {
  const control::FieldGradient made =
      model.field.matrix(place) * currents + model.field.background(place);
  return control::force_from_field(model.robot.moment(10e-3) * Eigen::Vector3d::UnitX()) * made -
         Eigen::Vector3d(0, 0, model.robot.net_weight(model.medium));
}

const Eigen::Vector3d kPlace(2e-3, -1e-3, 1e-3);

TEST(ServoController, EachLawPushesTheRobotBackToItsPlace) {
  for (const ControlLaw law : {ControlLaw::pd, ControlLaw::estimator, ControlLaw::velocity}) {
    ServoController loop(model(), settings(law));
    ControlStep step;
    // The velocity law builds its force up; the estimator expects it to sink until currents act.
    const double sinking =
        model().robot.net_weight({}) / control::resistance(model().robot, {}, {1, 0, 0})(2, 2);
    Eigen::Vector3d place = kPlace;
    for (int n = 0; n < 4; ++n) {
      if (law == ControlLaw::estimator) place.z() = kPlace.z() - sinking * std::min(n / 15.0, 0.14);
      step = loop.step(0.08 + n / 15.0, at(n / 15.0, place),
                       hold(place + Eigen::Vector3d(0.2e-3, 0, 0)), ControlMode::follow);
    }
    const Eigen::Vector3d force = force_of(model(), step.currents, place);
    EXPECT_GT(force.x(), 1e-8) << to_string(law);
    // The estimator's vertical force also takes up the fall, of which it has seen two frames.
    const double vertical = law == ControlLaw::estimator ? 0 : force.z();
    EXPECT_LT(std::hypot(force.y(), vertical), 0.3 * force.x()) << to_string(law);
  }
}

TEST(ServoController, LeavingItBeMakesNoForceButTheTrim) {
  ServoController loop(model(), settings(ControlLaw::pd));
  ControlStep step = loop.step(0.08, at(0, kPlace), hold({0, 0, 0}), ControlMode::leave);
  EXPECT_LT(force_of(model(), step.currents, kPlace).norm(), 1e-12);
  const Eigen::Vector3d trim(1e-6, 2e-6, -1e-6);
  loop.set_trim(trim, {0, 0, 0});
  step = loop.step(0.15, at(0.07, kPlace), hold({0, 0, 0}), ControlMode::leave);
  EXPECT_LT((force_of(model(), step.currents, kPlace) - trim).norm(), 1e-12);
}

TEST(ServoController, ConstantCurrentsAreThoseOfTheTrimmedPlaceWhereverTheRobotIs) {
  ServoController loop(model(), settings(ControlLaw::pd));
  loop.set_trim({0, 0, 1e-6}, {1e-3, 0, 0});
  const auto here = loop.step(0.08, at(0, kPlace), hold({0, 0, 0}), ControlMode::constant).currents;
  const auto there =
      loop.step(0.15, at(0.07, -kPlace), hold({0, 0, 0}), ControlMode::constant).currents;
  const auto unseen = loop.step(0.2, std::nullopt, hold({0, 0, 0}), ControlMode::constant).currents;
  EXPECT_EQ(here, there);
  EXPECT_EQ(here, unseen);
  EXPECT_LT((force_of(model(), here, {1e-3, 0, 0}) - Eigen::Vector3d(0, 0, 1e-6)).norm(), 1e-12);
}

TEST(ServoController, WhatADeadCoilDidTheOthersDoAndTheHeadroomSaysSo) {
  ControllerSettings seven = settings(ControlLaw::pd);
  seven.limits[2] = 0;
  ServoController whole(model(), settings(ControlLaw::pd)), lame(model(), seven);
  const ControlStep eight = whole.step(0.08, at(0, kPlace), hold({0, 0, 0}), ControlMode::leave),
                    less = lame.step(0.08, at(0, kPlace), hold({0, 0, 0}), ControlMode::leave);
  EXPECT_EQ(less.currents[2], 0);
  EXPECT_GT(std::abs(eight.currents[2]), 0.1) << "a coil that matters";
  EXPECT_LT(force_of(model(), less.currents, kPlace).norm(), 1e-12);
  EXPECT_LT(less.headroom, eight.headroom);
  EXPECT_GT(less.headroom, 0);
  EXPECT_FALSE(less.limited);
}

TEST(ServoController, WithTooFewLivingCoilsItStillLevitatesAndSaysThatItIsLimited) {
  ControllerSettings few = settings(ControlLaw::pd);
  few.limits << 12, 0, 12, 0, 12, 0, 0, 0;
  ServoController loop(model(), few);
  const ControlStep step = loop.step(0.08, at(0, kPlace), hold({0, 0, 0}), ControlMode::leave);
  EXPECT_TRUE(step.limited);
  EXPECT_NEAR(force_of(model(), step.currents, kPlace).z(), 0, 0.2 * model().robot.net_weight({}));
  few.limits.setZero();
  EXPECT_THROW(ServoController(model(), few), std::invalid_argument);
}

TEST(ServoController, TheSumOfCurrentsKeepsToItsLimit) {
  ControllerSettings tight = settings(ControlLaw::pd);
  tight.total_limit = 20;
  tight.gains.proportional = 50;
  tight.gains.max_speed = 20e-3;
  ServoController loop(model(), tight);
  const ControlStep step =
      loop.step(0.08, at(0, kPlace), hold({-3e-3, 0, 3e-3}), ControlMode::follow);
  EXPECT_LE(step.currents.cwiseAbs().sum(), 20);
  EXPECT_GE(force_of(model(), step.currents, kPlace).z(), -1e-9) << "it does not sink";
  EXPECT_TRUE(step.limited);
  tight.total_limit = 2;
  ServoController hopeless(model(), tight);
  EXPECT_THROW(hopeless.step(0.08, at(0, kPlace), hold(kPlace), ControlMode::follow),
               std::domain_error);
}

TEST(ServoController, AMeasurementThatIsNoUseIsPassedOver) {
  constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
  for (const ControlLaw law : {ControlLaw::pd, ControlLaw::estimator}) {
    ServoController loop(model(), settings(law));
    EXPECT_FALSE(loop.step(0.08, at(0, kPlace), hold(kPlace), ControlMode::follow).passed_over);
    EXPECT_TRUE(
        loop.step(0.15, at(0.07, {kNaN, 0, 0}), hold(kPlace), ControlMode::follow).passed_over)
        << "not a number";
    EXPECT_TRUE(loop.step(0.22, at(-0.07, kPlace), hold(kPlace), ControlMode::follow).passed_over)
        << "backwards";
    EXPECT_TRUE(loop.step(0.28, at(0.5, kPlace), hold(kPlace), ControlMode::follow).passed_over)
        << "from the future";
    const ControlStep step = loop.step(0.35, at(0.27, kPlace), hold(kPlace), ControlMode::follow);
    EXPECT_FALSE(step.passed_over);
    EXPECT_TRUE(step.currents.allFinite());
  }
  ServoController loop(model(), settings(ControlLaw::estimator));
  control::PositionMeasurement flat = at(0, kPlace);
  flat.covariance = -Eigen::Matrix3d::Identity();
  EXPECT_TRUE(loop.step(0.08, flat, hold(kPlace), ControlMode::follow).passed_over)
      << "no covariance";
}

TEST(ServoController, TheEstimatorGoesOnByPredictionWhereTheOthersWait) {
  ServoController estimator(model(), settings(ControlLaw::estimator)),
      pd(model(), settings(ControlLaw::pd));
  EXPECT_EQ(estimator.step(0, std::nullopt, hold(kPlace), ControlMode::follow).currents.size(), 0)
      << "nothing is known yet";
  estimator.step(0.08, at(0, kPlace), hold(kPlace), ControlMode::follow);
  pd.step(0.08, at(0, kPlace), hold(kPlace), ControlMode::follow);
  EXPECT_EQ(estimator.step(0.15, std::nullopt, hold(kPlace), ControlMode::follow).currents.size(),
            8);
  EXPECT_EQ(pd.step(0.15, std::nullopt, hold(kPlace), ControlMode::follow).currents.size(), 0);
  EXPECT_EQ(estimator.step(5, std::nullopt, hold(kPlace), ControlMode::follow).currents.size(), 0)
      << "too long ago";
}

TEST(ServoController, TheGainsComeFromTheLatencyThatWasSeenAndTheModel) {
  ServoController quick(model(), settings(ControlLaw::estimator)),
      slow(model(), settings(ControlLaw::estimator));
  EXPECT_FALSE(quick.tuning());
  quick.step(0.01, at(0, kPlace), hold(kPlace), ControlMode::follow);
  slow.step(0.2, at(0, kPlace), hold(kPlace), ControlMode::follow);
  EXPECT_GT(quick.tuning()->gains.proportional, 1.5 * slow.tuning()->gains.proportional);
  EXPECT_NEAR(quick.tuning()->horizon, 50e-3 + 1 / (2 * std::numbers::pi * 15), 1e-9);
  ControllerSettings given = settings(ControlLaw::estimator);
  given.proportional = 0.7;
  ServoController told(model(), given);
  told.step(0.08, at(0, kPlace), hold(kPlace), ControlMode::follow);
  EXPECT_EQ(told.tuning()->gains.proportional, 0.7);
}

TEST(ServoController, ItsMarginsAreSixDecibelsAndSixtyMillisecondsOrMore) {
  ServoController loop(model(), settings(ControlLaw::estimator));
  EXPECT_FALSE(loop.margins());
  const control::Trajectory path =
      control::Trajectory::line({0, 0, 0}, {3e-3, 0, 0}, {0.5e-3, 2e-3});
  double least_gain = 1e9, least_delay = 1e9;
  for (int n = 0; n < 90; ++n) {  // a robot that does as it is told: measured where it should be
    const double time = n / 15.0;
    loop.step(time + 0.08, at(time, path.at(time).position), {path, 0}, ControlMode::follow);
    const auto found = loop.margins();
    if (time < 3) continue;  // while it finds out, its gains are of the moment
    ASSERT_TRUE(found);
    EXPECT_TRUE(found->margins.stable);
    least_gain = std::min(least_gain, found->margins.gain_up);
    least_delay = std::min(least_delay, found->margins.delay_more);
  }
  EXPECT_GE(least_gain, 2);  // 6 dB
  EXPECT_GE(least_delay, 60e-3);
  ServoController pd(model(), settings(ControlLaw::pd));
  pd.step(0.08, at(0, kPlace), hold(kPlace), ControlMode::follow);
  EXPECT_FALSE(pd.margins());
}

TEST(ServoController, ASoftRobotsFieldIsRaisedWhereThatAsksLessOfTheCoilsAndAMagnetsIsNot) {
  const auto field_after = [](const RigModel& believed) {
    ControllerSettings free = settings(ControlLaw::estimator);
    free.field_max = 20e-3;
    ServoController loop(believed, free);
    ControlStep step;
    for (int n = 0; n < 60; ++n)
      step = loop.step(0.08 + n / 15.0, at(n / 15.0, kPlace), hold(kPlace), ControlMode::follow);
    return step.field;
  };
  RigModel magnet = model();
  magnet.robot = control::robot_named("ndfeb_cylinder_1mm");
  EXPECT_GT(field_after(model()), 12e-3);
  EXPECT_LT(field_after(model()), 20e-3);
  EXPECT_LT(field_after(magnet), field_after(model()));
}

// Round the thesis' square with coil 1 dead at 10 mT (facts/control_limits 7: 9 of 10 fail, 0 at
// 20).
TEST(FieldAllocator, WhereALimitCutsItNamesTheFieldThatHelps) {
  AllocatorSettings weak;
  weak.limits[0] = 0;
  const RigModel believed = model();
  const FieldAllocator allocator(believed, weak);
  int cut = 0, refused = 0;
  for (double x = -4e-3; x <= 4e-3; x += 1e-3) {
    for (const double z : {-3e-3, 0.0, 3e-3}) {
      const Eigen::Vector3d place(x, 0, z), force(0, 0, 1e-6);
      const auto stronger = allocator.stronger(place, force);
      try {
        if (!allocator.allocate(place, force).limited) continue;
        ++cut;
      } catch (const std::domain_error& error) {
        ++refused;
        EXPECT_NE(std::string(error.what()).find(": raise the field to "), std::string::npos)
            << error.what();
      }
      ASSERT_TRUE(stronger) << x << " " << z;
      AllocatorSettings raised = weak;
      raised.field = raised.field_max = *stronger;
      EXPECT_FALSE(FieldAllocator(believed, raised).allocate(place, force).limited);
      raised.field = raised.field_max = *stronger - 1e-3;
      if (raised.field > weak.field) {
        EXPECT_ANY_THROW(
            if (FieldAllocator(believed, raised).allocate(place, force).limited) throw 0);
      }
    }
  }
  EXPECT_GE(cut + refused, 1) << "a corner of the square";
}

TEST(FieldAllocator, WhereNoFieldHelpsItSaysSo) {
  AllocatorSettings weak;
  weak.limits.setConstant(0.05);
  const RigModel believed = model();
  const FieldAllocator allocator(believed, weak);
  try {
    allocator.allocate(kPlace, Eigen::Vector3d::Zero());
    FAIL() << "it cannot hold it";
  } catch (const std::domain_error& error) {
    EXPECT_NE(std::string(error.what()).find("no stronger field helps"), std::string::npos)
        << error.what();
  }
}

TEST(ServoController, OutsideTheModelsRegionTheNearestFieldIsUsedAndItSaysSo) {
  RigModel small = model();
  std::vector<control::MultipoleField::Sources> coils;
  const control::CoilField octomag = control::CoilField::octomag();
  for (const control::Dipole& dipole : octomag.dipoles()) {
    const double size = dipole.moment_per_ampere.norm();
    coils.push_back({{dipole.position, -dipole.moment_per_ampere / size, {}, {1e-7 * size}}});
  }
  const Eigen::Vector3d reach = Eigen::Vector3d::Constant(1.5e-3);
  small.field = control::MultipoleField(coils, {}, {-reach, reach});
  ServoController loop(small, settings(ControlLaw::pd));
  const ControlStep inside = loop.step(0.08, at(0, {1.5e-3, -1e-3, 1e-3}), hold({0, 0, 0}),
                                       ControlMode::leave),
                    outside =
                        loop.step(0.15, at(0.07, kPlace), hold({0, 0, 0}), ControlMode::leave);
  EXPECT_FALSE(inside.outside);
  EXPECT_TRUE(outside.outside);
  EXPECT_EQ(inside.currents, outside.currents);
  EXPECT_LT(force_of(model(), inside.currents, {1.5e-3, -1e-3, 1e-3}).norm(), 1e-10)
      << "the same field in both forms";
}

TEST(ServoController, TheFieldThatIsThereAnywayIsTakenOff) {
  RigModel windy = model();
  windy.field.set_uniform_background({0, 50e-6, -40e-6});
  ServoController loop(windy, settings(ControlLaw::pd));
  const auto currents =
      loop.step(0.08, at(0, kPlace), hold({0, 0, 0}), ControlMode::leave).currents;
  const control::FieldGradient made =
      windy.field.matrix(kPlace) * currents + windy.field.background(kPlace);
  EXPECT_LT((made.head<3>() - Eigen::Vector3d(10e-3, 0, 0)).norm(), 1e-12);
}

TEST(ServoController, WithWallDragItAsksForTheForceThatRetinaAndLensAddAndElsewhereForNoMore) {
  ControllerSettings walls = settings(ControlLaw::pd);
  walls.wall_drag = true;
  RigModel eyed = model();
  eyed.eye = optics::model_eye_5_3();
  const ServoController free(eyed, settings(ControlLaw::pd)), near(eyed, walls);
  const Eigen::Vector3d down(0, 0, -1), place(0, 0, -3.5e-3);
  // The plane's factors for the mean sphere 1.5 mm above the retina's vertex and 14 mm below the
  // lens.
  const double radius = std::cbrt(1e-3 * 0.5e-3 * 0.5e-3), bottom = radius / 1.5e-3;
  const double lens = radius / (eyed.eye.vertex(2) - 1.5e-3);
  const auto towards = [](double x) { return 1 / (1 - 9. / 8 * x + x * x * x / 2); };
  EXPECT_NEAR((near.drag_at(place) * down).norm() / (free.drag_at(place) * down).norm(),
              towards(bottom) * towards(lens), 1e-9);
  EXPECT_EQ(free.drag_at(place), free.drag_at(kPlace));
  // Beyond the wall, where a measurement may put it, it is as at the wall: finite.
  EXPECT_TRUE(near.drag_at({0, 0, -9e-3}).allFinite());
  ServoController loop(eyed, walls), other(eyed, settings(ControlLaw::pd));
  const auto pushed = [&](ServoController& one) {
    return -force_of(model(),
                     one.step(0.08, at(0, place), hold(place + 0.1e-3 * down), ControlMode::follow)
                         .currents,
                     place)
                .z();
  };
  EXPECT_GT(pushed(loop), 1.5 * pushed(other));
  EXPECT_THROW(ServoController(model(), walls), std::invalid_argument)
      << "without an eye there are no walls";
}

TEST(ServoController, OnlyTheEstimatorCanCancel) {
  ServoController loop(model(), settings(ControlLaw::pd));
  EXPECT_THROW(loop.step(0.08, at(0, kPlace), hold(kPlace), ControlMode::cancel),
               std::invalid_argument);
  EXPECT_THROW(control_law_named("pid"), std::invalid_argument);
}

TEST(ServoController, ARobotTooHeavyForTheCoilsIsAnErrorThatSaysSo) {
  ControllerSettings weak = settings(ControlLaw::pd);
  weak.limits.setConstant(0.05);
  ServoController loop(model(), weak);
  EXPECT_THROW(loop.step(0.08, at(0, kPlace), hold(kPlace), ControlMode::leave), std::domain_error);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
