// Servo controller: what it tells of its own loop (statistics, standstill, margins of a slow loop,
// the keep-out margin) and what it forgets.
// SPDX-License-Identifier: Apache-2.0
#include "control/command_history.h"
#include "control/innovation_statistics.h"
#include "control/robots.h"
#include "control/stability.h"
#include "host/servo/robot_clearance.h"
#include "host/servo/servo_controller.h"
#include "optics/system/prescriptions.h"

#include <Eigen/Core>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <stdexcept>

namespace vitreo {
namespace VITREO_TEST_FILE {

using Eigen::Matrix3d;
using Eigen::Vector3d;

RigModel watched_model() {
  RigModel model;
  model.robot = control::coni_2mm();
  model.medium.density = 960;
  model.medium.kinematic_viscosity = 420e-6;
  return model;
}

ControllerSettings watched_settings(ControlLaw law) {
  ControllerSettings settings;
  settings.law = law;
  settings.field = 12e-3;
  settings.axis = Vector3d(0.6, -0.5, 0.3).normalized();
  settings.period = 0.05;
  return settings;
}

control::PositionMeasurement seen_at(double time, const Vector3d& position) {
  return {time, position, Matrix3d::Identity() * 2e-11};
}

ReferencePath staying_at(const Vector3d& place) { return {control::Trajectory::hold_at(place), 0}; }

TEST(ServoControllerWatch, TheStatisticsAreOfTheInnovationsThatWereUsedByTheTimeBetweenThem) {
  ServoController controller(watched_model(), watched_settings(ControlLaw::estimator));
  control::InnovationStatistics wanted(10);
  const Vector3d place(1e-3, -0.5e-3, 1e-3);
  double time = 5.3, before = 0;
  for (int k = 0; k < 40; ++k, time += 0.04 + 0.03 * (k % 3)) {
    const bool wild = k % 9 == 8;  // beyond the gate: of no use, and in no statistics
    const Vector3d off = wild ? Vector3d(6e-3, 0, 0) : Vector3d(2e-5, -1e-5, 3e-5) * (k % 4 - 1.5);
    const ControlStep step = controller.step(time + 0.09, seen_at(time, place + off),
                                             staying_at(place), ControlMode::follow);
    EXPECT_EQ(step.passed_over, wild) << k;
    if (wild) continue;
    if (controller.estimator()->innovation())
      wanted.add(*controller.estimator()->innovation(), time - before);
    before = time;
  }
  ASSERT_TRUE(controller.margins());
  EXPECT_NEAR(controller.margins()->innovation, wanted.normalized(), 1e-12);
  EXPECT_NEAR(controller.margins()->correlation, wanted.correlation(), 1e-12);
  EXPECT_GT(std::abs(wanted.correlation()), 0.05);
}

// The command against a constant push does not change, however strong it is.
TEST(ServoControllerWatch, AConstantCommandStirsTheScheduleNoMoreThanNone) {
  ServoController controller(watched_model(), watched_settings(ControlLaw::estimator));
  const Vector3d place(0, 0, 1e-3);
  control::CommandHistory plant(watched_model().command_delay,
                                1 / (2 * M_PI * watched_model().command_bandwidth));
  const Vector3d push(0.4e-3, -0.2e-3, 0.1e-3);  // m/s
  Vector3d position = place, flowing(0, 0, 0), last(0, 0, 0);
  std::optional<control::ServoSchedule> expected;
  for (int k = 0; k < 160; ++k) {
    const double time = 5 + 0.05 * k;
    const auto motion = plant.advance(flowing, time - 0.05, time);
    flowing = motion.velocity;
    position += motion.moved + 0.05 * push;
    const ControlStep step = controller.step(time + 0.02, seen_at(time, position),
                                             staying_at(place), ControlMode::follow);
    plant.add(time + 0.02, step.commanded);
    const auto margins = controller.margins();
    if (!margins) continue;
    const Vector3d commanded = margins->estimate.commanded;
    if (k > 60)
      expected = control::schedule(*controller.tuning(), margins->estimate,
                                   {0, (commanded - last).norm()});
    last = commanded;
    if (!expected) continue;
    EXPECT_NEAR(margins->schedule.bandwidth, expected->bandwidth, 1e-9) << k;
    EXPECT_NEAR(margins->schedule.proportional, expected->proportional, 1e-9) << k;
  }
  ASSERT_TRUE(expected);
  EXPECT_GT(last.norm(), 0.3e-3);
  const auto stirred =
      control::schedule(*controller.tuning(), controller.margins()->estimate, {0, last.norm()});
  EXPECT_GT(std::abs(stirred.bandwidth - expected->bandwidth), 1e-3) << "else this tells nothing";
  // After a reset it counts as a controller's first command.
  controller.reset();
  ServoController fresh(watched_model(), watched_settings(ControlLaw::estimator));
  for (int k = 0; k < 2; ++k) {
    const auto step = [&](ServoController& one) {
      return one.step(20.02 + 0.05 * k, seen_at(20 + 0.05 * k, place),
                      staying_at(place + Vector3d(0.3e-3, 0, 0)), ControlMode::follow);
    };
    EXPECT_EQ(step(controller).commanded, step(fresh).commanded) << k;
    if (!fresh.margins()) continue;
    EXPECT_EQ(controller.margins()->schedule.bandwidth, fresh.margins()->schedule.bandwidth) << k;
  }
}

TEST(ServoControllerWatch, ARobotThatStandsBesideItsTargetIsToldAndOneThatGoesIsNot) {
  for (const bool stands : {true, false}) {
    ServoController controller(watched_model(), watched_settings(ControlLaw::estimator));
    const Vector3d target(1e-3, 0, 1e-3);
    bool told = false;
    bool capped = false;
    double told_at = 0;
    for (int k = 0; k < 120 && !(told && capped); ++k) {
      const double time = 5 + 0.05 * k;
      const Vector3d gone =
          stands ? Vector3d(0, 0, 0) : Vector3d(std::min(1.2e-3 * (time - 5), 4e-3), 0, 0);
      const ControlStep step =
          controller.step(time + 0.08, seen_at(time, Vector3d(-3e-3, 0, 1e-3) + gone),
                          staying_at(target), ControlMode::follow);
      capped = capped || step.quality.capped;
      if (step.quality.standing && !told) told_at = time;
      told = told || step.quality.standing;
    }
    EXPECT_EQ(told, stands);
    EXPECT_EQ(capped, stands) << "its largest speed was asked for all the time";
    if (stands) {
      EXPECT_LT(told_at, 5 + control::kCaught + 3);
    }
  }
}

// 40 um to and fro once a second, of a place that is known to 4.5 um. About a target that goes
// round itself at 2 mm/s a sound loop shows as much.
TEST(ServoControllerWatch, AnOscillationIsNamedUnlessTheTargetsOwnMotionExplainsIt) {
  for (const bool round : {false, true}) {
    ServoController controller(watched_model(), watched_settings(ControlLaw::pd));
    ReferencePath path = staying_at({1e-3, 0, 1e-3});
    if (round)
      path = {control::Trajectory::circle({1e-3, 0, 1e-3}, {0.5e-3, 0, 0}, {0, 0.5e-3, 0}, 20,
                                          {2e-3, 20e-3}),
              4};
    bool named = false;
    for (int k = 0; k < 240; ++k) {
      const double time = 5 + 0.05 * k;
      const Vector3d off(40e-6 * std::sin(2 * M_PI * time), 0, 0);
      const ControlStep step = controller.step(
          time + 0.08, seen_at(time, path.at(time).position + off), path, ControlMode::follow);
      named = named || step.quality.oscillating;
    }
    EXPECT_EQ(named, !round);
  }
}

TEST(ServoControllerWatch, InnovationsThatStayLargeAreInconsistent) {
  for (const bool large : {true, false}) {
    ServoController controller(watched_model(), watched_settings(ControlLaw::estimator));
    const Vector3d place(1e-3, -0.5e-3, 1e-3);
    bool told = false;
    for (int k = 0; k < 300; ++k) {
      const double time = 5 + 0.05 * k;
      const double size = large ? 0.2e-3 : 4e-6;
      const Vector3d off = size * Vector3d(k % 2 == 0 ? 1 : -1, k % 3 - 1, 0);
      told =
          controller
              .step(time + 0.08, seen_at(time, place + off), staying_at(place), ControlMode::follow)
              .inconsistent;
    }
    EXPECT_EQ(told, large);
  }
}

TEST(ServoControllerWatch, ALoopOfOneFrameInTwoSecondsHasMarginsToo) {
  ControllerSettings settings = watched_settings(ControlLaw::estimator);
  settings.period = 0.9;  // s
  ServoController controller(watched_model(), settings);
  for (int k = 0; k < 12; ++k) {
    const double time = 5 + 0.9 * k;
    controller.step(time + 2.5, seen_at(time, {1e-3, 0, 1e-3}), staying_at({1e-3, 0, 1e-3}),
                    ControlMode::follow);
  }
  ASSERT_TRUE(controller.margins());
  EXPECT_LT(controller.margins()->schedule.bandwidth, 1) << "rad/s";
  EXPECT_GT(controller.margins()->schedule.bandwidth, 0);
}

TEST(ServoControllerWatch, AResetForgetsWhatTheOtherLawsHadGathered) {
  for (const ControlLaw law : {ControlLaw::pd, ControlLaw::velocity}) {
    ControllerSettings settings = watched_settings(law);
    settings.gains = {1.1, 0.3, 0.15, 3e-3, 0.4};
    settings.velocity = {0.7, 1e-3, 0.2, 0.11, 150e-6};
    ServoController used(watched_model(), settings);
    const ReferencePath path = staying_at({1e-3, 0.5e-3, 1e-3});
    for (int k = 0; k < 20; ++k)
      used.step(5.09 + 0.05 * k, seen_at(5 + 0.05 * k, {0.6e-3, 0.5e-3 - 1e-5 * k, 1e-3}), path,
                ControlMode::follow);
    ServoController kept(watched_model(), settings);
    for (int k = 0; k < 20; ++k)
      kept.step(5.09 + 0.05 * k, seen_at(5 + 0.05 * k, {0.6e-3, 0.5e-3 - 1e-5 * k, 1e-3}), path,
                ControlMode::follow);
    used.reset();
    ServoController fresh(watched_model(), settings);
    double forgotten = 0;
    for (int k = 0; k < 5; ++k) {
      const double time = 6.2 + 0.05 * k;
      const auto seen = seen_at(time, {0.9e-3, 0.4e-3, 1.1e-3 + 1e-5 * k});
      const auto after = used.step(time + 0.09, seen, path, ControlMode::follow).currents;
      const auto wanted = fresh.step(time + 0.09, seen, path, ControlMode::follow).currents;
      const auto without = kept.step(time + 0.09, seen, path, ControlMode::follow).currents;
      EXPECT_EQ(after, wanted) << to_string(law) << ' ' << k;
      forgotten = std::max(forgotten, (without - wanted).norm());
    }
    EXPECT_GT(forgotten, 1e-4) << to_string(law) << ": else there was nothing to forget";
  }
}

TEST(ServoControllerWatch, ARobotLetGoIsCaughtAsIfItHadNotBeenFollowed) {
  for (const ControlLaw law : {ControlLaw::pd, ControlLaw::velocity}) {
    ControllerSettings settings = watched_settings(law);
    settings.gains = {1.1, 0.3, 0.15, 3e-3, 0.4};
    settings.velocity = {0.7, 1e-3, 0.2, 0.11, 150e-6};
    ServoController released(watched_model(), settings);
    ServoController fresh(watched_model(), settings);
    const ReferencePath path = staying_at({1e-3, 0.5e-3, 1e-3});
    const auto seen = [](int k) {
      return seen_at(5 + 0.05 * k, {0.6e-3, 0.5e-3 - 1e-5 * k, 1e-3});
    };
    for (int k = 0; k < 20; ++k) released.step(5.09 + 0.05 * k, seen(k), path, ControlMode::follow);
    released.step(6.09, seen(20), path, ControlMode::leave);
    for (int k = 21; k < 25; ++k)
      EXPECT_EQ(released.step(5.09 + 0.05 * k, seen(k), path, ControlMode::follow).currents,
                fresh.step(5.09 + 0.05 * k, seen(k), path, ControlMode::follow).currents)
          << to_string(law) << ' ' << k;
  }
}

TEST(ServoControllerWatch, AnotherAxisIsThatOfAControllerMadeForIt) {
  for (const ControlLaw law : {ControlLaw::pd, ControlLaw::estimator}) {
    ControllerSettings settings = watched_settings(law);
    ServoController turned(watched_model(), settings);
    settings.axis = Vector3d(-0.2, 0.9, 0.4).normalized();
    turned.set_axis(settings.axis);
    ServoController made(watched_model(), settings);
    for (int k = 0; k < 6; ++k) {
      const auto seen = seen_at(5 + 0.05 * k, {0.6e-3, 0.5e-3 - 1e-5 * k, 1e-3});
      const auto step =
          turned.step(5.09 + 0.05 * k, seen, staying_at({1e-3, 0, 1e-3}), ControlMode::follow);
      const auto wanted =
          made.step(5.09 + 0.05 * k, seen, staying_at({1e-3, 0, 1e-3}), ControlMode::follow);
      EXPECT_EQ(step.currents, wanted.currents) << k;
      EXPECT_EQ(step.commanded, wanted.commanded) << k;
    }
  }
}

TEST(ServoControllerWatch, AViewThatWasMovedIsNoMotionOfTheRobot) {
  const Vector3d by(0.3e-3, -0.2e-3, 0.1e-3);
  ServoController moved(watched_model(), watched_settings(ControlLaw::estimator));
  ServoController still(watched_model(), watched_settings(ControlLaw::estimator));
  const Vector3d place(1e-3, 0, 1e-3);
  for (int k = 0; k < 60; ++k) {
    const double time = 5 + 0.05 * k;
    const Vector3d at = place + Vector3d(2e-5, 1e-5, 0) * (k % 3);
    const bool after = k >= 30;
    if (k == 30) moved.view_moved(by);
    const Vector3d shift = after ? by : Vector3d(0, 0, 0);
    const auto wanted =
        still.step(time + 0.08, seen_at(time, at), staying_at(place), ControlMode::follow);
    const auto step = moved.step(time + 0.08, seen_at(time, at + shift), staying_at(place + shift),
                                 ControlMode::follow);
    ASSERT_TRUE(step.estimate && wanted.estimate);
    EXPECT_LT((step.estimate->position - wanted.estimate->position - shift).norm(), 1e-9) << k;
    EXPECT_LT((step.estimate->disturbance - wanted.estimate->disturbance).norm(), 1e-8) << k;
  }
}

TEST(ServoControllerWatch, BoundsThemselves) {
  ControllerSettings settings = watched_settings(ControlLaw::estimator);
  settings.field_max = settings.field;
  ServoController controller(watched_model(), settings);
  const auto at_once =
      controller.step(5, seen_at(5, {0, 0, 1e-3}), staying_at({0, 0, 1e-3}), ControlMode::follow);
  EXPECT_FALSE(at_once.passed_over) << "measured when the currents are set";
  EXPECT_THROW(controller.set_trim({0, std::nan(""), 0}, {0, 0, 0}), std::invalid_argument);
  settings.proportional = 0;
  EXPECT_THROW(ServoController(watched_model(), settings), std::invalid_argument);
  settings.proportional = 2;
  settings.max_speed = 0;
  EXPECT_THROW(ServoController(watched_model(), settings), std::invalid_argument);
}

TEST(ServoControllerWatch, ItIsToldWhenTheMarginHasChangedTheCommand) {
  RigModel model = watched_model();
  model.eye = optics::model_eye_5_3();
  model.eye_in_world = {0, 0, -5e-3};
  const RobotClearance clearance(model, {Vector3d::UnitX(), 0, false, false});
  const Vector3d middle = model.eye_in_world + Vector3d(0, 0, model.eye.vertex(2) / 2);
  const auto nearest = [&](const Vector3d& at) { return clearance.at(at)->retina.distance; };
  Vector3d low = middle;
  while (nearest(low) > clearance.margin() + 0.1e-3) low.z() -= 0.05e-3;
  for (const ControlLaw law : {ControlLaw::pd, ControlLaw::velocity, ControlLaw::estimator}) {
    for (const bool at_wall : {true, false}) {
      ControllerSettings settings = watched_settings(law);
      settings.gains = {1.1, 0.3, 0.15, 3e-3, 0.4};
      settings.velocity = {0.7, 1e-3, 0.2, 0.11, 150e-6};
      ServoController controller(model, settings);
      ServoController free(model, settings);
      controller.keep_out(&clearance);
      const Vector3d place = at_wall ? low : middle;
      const ReferencePath path = staying_at(place - Vector3d(0, 0, 1e-3));
      bool told = false;
      bool cut = false;
      for (int k = 0; k < 30; ++k) {
        const double time = 5 + 0.05 * k;
        const ControlStep step =
            controller.step(time + 0.08, seen_at(time, place), path, ControlMode::follow);
        const ControlStep unbound =
            free.step(time + 0.08, seen_at(time, place), path, ControlMode::follow);
        told = told || step.kept_out;
        cut = cut || (step.currents - unbound.currents).norm() > 1e-6;
        EXPECT_FALSE(unbound.kept_out);
      }
      EXPECT_EQ(told, at_wall) << to_string(law);
      EXPECT_EQ(cut, at_wall) << to_string(law);
    }
  }
}

TEST(ServoControllerWatch, AMarginThatHasLongChangedTheCommandIsNoGoodControl) {
  RigModel model = watched_model();
  model.eye = optics::model_eye_5_3();
  model.eye_in_world = {0, 0, -5e-3};
  const RobotClearance clearance(model, {Vector3d::UnitX(), 0, false, false});
  Vector3d low = model.eye_in_world + Vector3d(0, 0, model.eye.vertex(2) / 2);
  while (clearance.at(low)->retina.distance > clearance.margin() + 0.1e-3) low.z() -= 0.05e-3;
  for (const ControlLaw law : {ControlLaw::pd, ControlLaw::estimator}) {
    ServoController controller(model, watched_settings(law));
    controller.keep_out(&clearance);
    const auto step = [&](double time, double lower) {
      return controller.step(time + 0.08, seen_at(time, low),
                             staying_at(low - Vector3d(0, 0, lower)), ControlMode::follow);
    };
    double time = 5, since = -1, named = -1;
    for (; time < 12; time += 0.05) {
      const ControlStep now = step(time, 1e-3);
      if (now.kept_out && since < 0) since = time;
      if (now.quality.kept_out && named < 0) named = time;
      EXPECT_FALSE(now.quality.kept_out && now.quality.good());
    }
    ASSERT_GE(since, 0) << to_string(law);
    EXPECT_NEAR(named - since, 3, 0.2) << to_string(law);
    // It rises to where no wall is near.
    bool still = true;
    for (; still && time < 30; time += 0.05) {
      const Vector3d place = low + Vector3d(0, 0, std::min(3e-3, 1e-3 * (time - 12)));
      still =
          controller.step(time + 0.08, seen_at(time, place), staying_at(place), ControlMode::follow)
              .quality.kept_out;
    }
    EXPECT_LT(time, 30) << to_string(law) << ": and no longer when it has not";
  }
}

// What the robot is to do towards the wall, its drift with it, is a quarter of the dead time's
// inverse times what is left to the rig's margin.
TEST(ServoControllerWatch, TowardsAWallItGoesAsFastAsTheRigsMarginLeavesIt) {
  RigModel model = watched_model();
  model.eye = optics::model_eye_5_3();
  model.eye_in_world = {0, 0, -5e-3};
  model.keep_out.margin = 0.7e-3;
  const RobotClearance clearance(model, {Vector3d::UnitX(), 0, false, false});
  Vector3d low = model.eye_in_world + Vector3d(0, 0, model.eye.vertex(2) / 2);
  while (clearance.at(low)->retina.distance > 1.2e-3) low.z() -= 0.05e-3;
  ServoController controller(model, watched_settings(ControlLaw::estimator));
  controller.keep_out(&clearance);
  int kept = 0;
  for (int k = 0; k < 30; ++k) {
    const double time = 5 + 0.05 * k;
    const ControlStep step =
        controller.step(time + 0.08, seen_at(time, low - Vector3d(0, 0, 2e-6 * k)),
                        staying_at(low - Vector3d(0, 0, 2e-3)), ControlMode::follow);
    const auto margins = controller.margins();
    if (!margins || !step.kept_out || step.limited) continue;
    const control::PositionEstimate& ahead = margins->estimate;
    const auto near = clearance.at(ahead.position, ahead.covariance.topLeftCorner<3, 3>());
    control::KeepOut settings;
    settings.margin = 0.7e-3;
    settings.rate = 0.25 / controller.tuning()->loop.dead_time();
    const Vector3d down(0, 0, -5e-3);
    const double allowed = control::keep_out(settings, *near, down).velocity.z();
    const Vector3d goes = ahead.disturbance + (1 + ahead.gain) * step.commanded;
    EXPECT_NEAR(goes.z(), allowed, 1e-7) << k << ": m/s; the normal is not quite vertical";
    kept += std::abs(allowed) < 0.45e-3 && std::abs(ahead.gain) > 0.01 &&
                    ahead.disturbance.norm() > 1e-6
                ? 1
                : 0;
  }
  EXPECT_GT(kept, 10);
}

// Thesis 7.3: the force of velocity control rises until the medium yields. A gel gives way to a
// force before it yields, an old place does not.
TEST(ServoControllerWatch, ARobotThatNoForceMovesInAGelIsHeldOrNotWhatIsSeen) {
  const RigModel model = watched_model();
  const double radius = model.robot.semi_radius;
  const auto stood_at = [&](double modulus) {  // s; 0: never. Pa, 0: whatever the force
    ServoController controller(model, watched_settings(ControlLaw::velocity));
    Vector3d place(0, 0, 0);
    for (int k = 0; k < 600; ++k) {
      const double time = 0.05 * k;
      const Vector3d noise = 4e-6 * Vector3d(std::sin(37.0 * k), std::sin(53.0 * k), 0);
      const ControlStep step = controller.step(time + 0.08, seen_at(time, place + noise),
                                               staying_at({1e-3, 0, 0}), ControlMode::follow);
      if (step.standing) return time;
      if (modulus == 0) continue;
      Vector3d force =
          control::force_at(model.field, model.robot, model.medium, step.currents, place);
      force.z() = 0;
      place = force / (6 * M_PI * modulus * radius);
    }
    return 0.0;
  };
  const double old_place = stood_at(0);
  EXPECT_GT(old_place, 2) << "s";
  EXPECT_LT(old_place, 10) << "s";
  EXPECT_EQ(stood_at(2.8), 0) << "porcine vitreous an hour out of the eye";
  EXPECT_EQ(stood_at(14), 0) << "and in it";
  EXPECT_EQ(stood_at(28), 0);
}

// The robot of a law without prediction is thrown as far as its speed takes it in a dead time.
TEST(ServoControllerWatch, APdGoesNoFasterThanTheEyeIsWide) {
  RigModel model = watched_model();
  model.eye = optics::model_eye_5_3();
  model.eye_in_world = {0, 0, -5e-3};
  const RobotClearance clearance(model, {Vector3d::UnitX(), 0, false, false});
  const Vector3d middle = model.eye_in_world + Vector3d(0, 0, model.eye.vertex(2) / 2);
  Vector3d low = middle;
  while (clearance.at(low)->retina.distance > clearance.margin() + 0.1e-3) low.z() -= 0.05e-3;
  ControllerSettings settings = watched_settings(ControlLaw::pd);
  settings.gains.max_speed = 0.1;
  settings.gains.proportional = 100;
  const auto asked = [&](const Vector3d& place, bool keeps) {
    ServoController controller(model, settings);
    if (keeps) controller.keep_out(&clearance);
    const control::PositionMeasurement seen = seen_at(5, place);
    return controller
        .step(5.08, seen, staying_at(place + Vector3d(0, 0, 1e-3)), ControlMode::follow)
        .correction.norm();
  };
  ServoController known(model, settings);
  known.keep_out(&clearance);
  known.step(5.08, seen_at(5, middle), staying_at(middle), ControlMode::follow);
  const auto near = clearance.at(middle, seen_at(5, middle).covariance);
  const double left = near->nearest().bound() - clearance.margin();
  ASSERT_GT(left, 3e-3);
  EXPECT_NEAR(asked(middle, true), 0.5 * left / known.tuning()->loop.dead_time(), 1e-6);
  EXPECT_NEAR(asked(low, true), 2e-3, 1e-9) << "m/s, which bring it away from the wall";
  EXPECT_NEAR(asked(middle, false), 0.1, 1e-9);
}

// Of a loop that has become unstable the filter, by which the margin is kept, believes anything.
TEST(ServoControllerWatch, TheMarginMakesNoCommandFasterThanWhatIsAskedFor) {
  RigModel model = watched_model();
  model.eye = optics::model_eye_5_3();
  model.eye_in_world = {0, 0, -5e-3};
  const RobotClearance clearance(model, {Vector3d::UnitX(), 0, false, false});
  Vector3d low = model.eye_in_world + Vector3d(0, 0, model.eye.vertex(2) / 2);
  while (clearance.at(low)->retina.distance > clearance.margin() + 0.5e-3) low.z() -= 0.05e-3;
  ServoController controller(model, watched_settings(ControlLaw::pd));
  controller.keep_out(&clearance);
  int kept = 0;
  for (int k = 0; k < 60; ++k) {
    const double time = 5 + 0.05 * k;
    const Vector3d thrown = low + Vector3d(0, 0, 1.5e-3 + 1.5e-3 * std::sin(15 * time));
    const ControlStep step =
        controller.step(time + 0.08, seen_at(time, thrown), staying_at(low), ControlMode::follow);
    if (!step.kept_out || step.limited) continue;
    const Vector3d force =
        control::force_at(model.field, model.robot, model.medium, step.currents, thrown);
    const Vector3d goes = controller.drag_at(thrown).inverse() * force;
    // m/s: the law's limit and its floor are 2 mm/s; it is held up beside that.
    EXPECT_LT(goes.norm(), 2.1e-3) << k;
    ++kept;
  }
  EXPECT_GT(kept, 5);
}

// What the filter's gate refused says nothing of the coils.
TEST(ServoControllerWatch, WildMeasurementsAccuseNoCoil) {
  ServoController controller(watched_model(), watched_settings(ControlLaw::estimator));
  const Vector3d place(2e-3, 1e-3, 1e-3);
  for (int k = 0; k < 400; ++k) {
    const double time = 5 + 0.05 * k;
    const bool wild = k > 60 && k % 4 == 0;
    const Vector3d off = wild ? Vector3d(2e-3, 1e-3, -4e-3) : Vector3d(0, 0, 0);
    const ControlStep step = controller.step(time + 0.08, seen_at(time, place + off),
                                             staying_at(place), ControlMode::follow);
    EXPECT_EQ(step.passed_over, wild) << k;
    ASSERT_EQ(step.quality.weak_coil, 0) << k;
  }
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
