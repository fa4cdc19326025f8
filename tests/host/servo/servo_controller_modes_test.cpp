// Servo controller: a robot that is let go, the keep-out margin under the laws without a filter,
// walls above the equator, and what its watch is told of target, axis and view.
// SPDX-License-Identifier: Apache-2.0
#include "control/keep_out.h"
#include "control/robots.h"
#include "host/servo/robot_clearance.h"
#include "host/servo/servo_controller.h"
#include "optics/system/prescriptions.h"

#include <Eigen/Core>
#include <Eigen/LU>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <optional>
#include <stdexcept>
#include <utility>

namespace vitreo {
namespace VITREO_TEST_FILE {

using Eigen::Matrix3d;
using Eigen::Vector3d;

RigModel moded_model() {
  RigModel model;
  model.robot = control::coni_2mm();
  model.medium.density = 960;
  model.medium.kinematic_viscosity = 420e-6;
  return model;
}

RigModel model_in_eye() {
  RigModel model = moded_model();
  model.eye = optics::model_eye_5_3();
  model.eye_in_world = {0, 0, -5e-3};
  return model;
}

ControllerSettings moded_settings(ControlLaw law) {
  ControllerSettings settings;
  settings.law = law;
  settings.field = 12e-3;
  settings.axis = Vector3d(0.6, -0.5, 0.3).normalized();
  settings.period = 0.05;
  settings.gains = {1.1, 0.3, 0.15, 3e-3, 0.4};
  settings.velocity = {0.7, 1e-3, 0.2, 0.11, 150e-6};
  return settings;
}

control::PositionMeasurement taken_at(double time, const Vector3d& position, double sigma = 4e-6) {
  return {time, position, Matrix3d::Identity() * sigma * sigma};
}

ReferencePath resting_at(const Vector3d& place) { return {control::Trajectory::hold_at(place), 0}; }

/// m/s, of a robot that nothing carries.
Vector3d sinking(const ServoController& controller, const RigModel& model, const Vector3d& place) {
  return controller.drag_at(place).inverse() *
         Vector3d(0, 0, -model.robot.net_weight(model.medium));
}

TEST(ServoControllerModes, WallDragWantsAnEyeWhoseSurfacesReachTheLens) {
  ControllerSettings settings = moded_settings(ControlLaw::pd);
  settings.wall_drag = true;
  RigModel model = model_in_eye();
  model.eye.surfaces.resize(3);
  EXPECT_NO_THROW(ServoController(model, settings));
  model.eye.surfaces.resize(2);
  EXPECT_THROW(ServoController(model, settings), std::invalid_argument);
}

// The retina's sphere below its equator, a cylinder above it, and the lens' plane.
TEST(ServoControllerModes, WallsAboveTheEquatorAreACylinders) {
  const RigModel model = model_in_eye();
  ControllerSettings settings = moded_settings(ControlLaw::pd);
  settings.wall_drag = true;
  const ServoController controller(model, settings);
  const double radius = model.eye.surfaces.front().radius;
  const Vector3d center = model.eye_in_world + Vector3d(0, 0, radius);
  const Matrix3d free = control::resistance(model.robot, model.medium, settings.axis);
  for (const Vector3d& from_center : {Vector3d(7e-3, -5e-3, 2e-3), Vector3d(7e-3, -5e-3, -2e-3)}) {
    const Vector3d out(from_center.x(), from_center.y(), std::min(from_center.z(), 0.0));
    const double lens = model.eye_in_world.z() + model.eye.vertex(2) - (center + from_center).z();
    const Matrix3d beside =
        control::resistance_near_wall(free, model.robot, -out.normalized(), radius - out.norm());
    const Matrix3d wanted =
        control::resistance_near_wall(beside, model.robot, Vector3d::UnitZ(), lens);
    const Matrix3d found = controller.drag_at(center + from_center);
    EXPECT_LT((found - wanted).norm(), 1e-12 * wanted.norm()) << from_center.transpose();
    EXPECT_GT((found - free).norm(), 0.05 * free.norm());
  }
}

TEST(ServoControllerModes, WithoutCurrentsNoLimitCostsAnything) {
  const ControllerSettings settings = moded_settings(ControlLaw::pd);
  for (const ControlMode mode : {ControlMode::leave, ControlMode::off}) {
    ServoController controller(moded_model(), settings);
    controller.set_trim({200e-6, 0, 0}, {0, 0, 1e-3});  // 20 times its weight
    const ControlStep step =
        controller.step(5.05, taken_at(5, {0, 0, 1e-3}), resting_at({0, 0, 1e-3}), mode);
    EXPECT_EQ(step.limited, mode == ControlMode::leave);
    EXPECT_EQ(step.currents.norm() > 0, mode == ControlMode::leave);
  }
}

TEST(ServoControllerModes, WhatAFilterKnowsIsToldOfTheLawThatUsesIt) {
  const RigModel model = model_in_eye();
  const RobotClearance clearance(model, {Vector3d::UnitX(), 0, false, false});
  ServoController pd(model, moded_settings(ControlLaw::pd));
  pd.keep_out(&clearance);
  ServoController estimator(model, moded_settings(ControlLaw::estimator));
  EXPECT_EQ(estimator.estimator(), nullptr);
  EXPECT_FALSE(estimator.margins());
  for (int k = 0; k < 5; ++k) {
    for (ServoController* each : {&pd, &estimator})
      each->step(5.05 + 0.05 * k, taken_at(5 + 0.05 * k, {0, 0, 1e-3}), resting_at({0, 0, 1e-3}),
                 ControlMode::follow);
    EXPECT_EQ(pd.estimator(), nullptr);
    EXPECT_FALSE(pd.margins());
    EXPECT_NE(estimator.estimator(), nullptr);
    EXPECT_EQ(estimator.margins().has_value(), k > 0) << "the first has no innovation";
  }
}

TEST(ServoControllerModes, ARobotLetGoSinksInItsBeliefToo) {
  const RigModel model = moded_model();
  ServoController controller(model, moded_settings(ControlLaw::estimator));
  const Vector3d place(0, 0, 1e-3);
  double now = 5.05;
  for (int k = 0; k < 30; ++k, now += 0.05)
    controller.step(now, taken_at(now - 0.05, place), resting_at(place), ControlMode::follow);
  std::optional<control::PositionEstimate> before;
  const Vector3d falls = sinking(controller, model, place);
  for (int k = 0; k < 16; ++k, now += 0.05) {
    const ControlStep step =
        controller.step(now, std::nullopt, resting_at(place), ControlMode::off);
    ASSERT_TRUE(step.estimate);
    EXPECT_EQ(step.currents.norm(), 0);
    EXPECT_LT((step.commanded - falls).norm(), 1e-12);
    if (before && k > 8) {  // beyond delay and lag
      const Vector3d velocity = (step.estimate->position - before->position) / 0.05;
      const Vector3d wanted = before->disturbance + (1 + before->gain) * falls;
      EXPECT_LT((velocity - wanted).norm(), 0.01 * falls.norm()) << k;
    }
    before = step.estimate;
  }
}

// What it passed through is still being found out: by 0.92 s (docs/control.md). A reference that
// nothing follows asks for nothing.
TEST(ServoControllerModes, AReferencesSpeedCountsWhileItIsFollowedAndFadesOnceItHasStopped) {
  for (const int left_from : {1000, 80}) {
    ServoController controller(moded_model(), moded_settings(ControlLaw::estimator));
    const Vector3d from(0, 0, 1e-3), velocity(0.9e-3, 0, 0);
    const ReferencePath path{control::Trajectory::glide(from, velocity, 6), 5};
    double remembered = 0, most = 0, least = 1e9;
    Vector3d last(0, 0, 0);
    bool known = false;
    for (int k = 0; k < 200; ++k) {
      const double time = 5 + 0.05 * k;
      const ControlMode mode = k < left_from ? ControlMode::follow : ControlMode::leave;
      const Vector3d place = path.at(std::min(time, 5 + 0.05 * left_from)).position;
      const ControlStep step =
          controller.step(time + 0.05, taken_at(time, place, 30e-6), path, mode);
      ASSERT_TRUE(step.estimate);
      const double then = time + 0.05 + controller.tuning()->horizon + step.estimate->delay;
      const double speed = ((path.at(then + 0.05).position - path.at(then).position) / 0.05).norm();
      remembered =
          std::max(mode == ControlMode::follow ? speed : 0.0, remembered * std::exp(-0.05 / 0.92));
      const auto margins = controller.margins();
      if (!margins) continue;
      const auto wanted =
          control::schedule(*controller.tuning(), margins->estimate,
                            {remembered, (margins->estimate.commanded - last).norm()});
      last = margins->estimate.commanded;
      if (!std::exchange(known, true)) continue;
      EXPECT_NEAR(margins->schedule.bandwidth, wanted.bandwidth, 1e-6 * wanted.bandwidth) << k;
      if (k < std::min(left_from, 120) + 5) continue;
      most = std::max(most, wanted.bandwidth);
      least = std::min(least, wanted.bandwidth);
    }
    EXPECT_GT(most, 1.2 * least) << "else the memory tells nothing";
  }
}

/// A law without a filter that follows, exactly, a path down to the retina.
struct Descent {
  RigModel model = model_in_eye();
  RobotClearance clearance{model, {Vector3d::UnitX(), 0, false, false}};
  Vector3d velocity{0.1e-3, -0.05e-3, -0.9e-3};  // m/s
  Vector3d trim{0.4e-6, -0.3e-6, 0.2e-6};        // N
  ReferencePath path() const {
    Vector3d from = model.eye_in_world + Vector3d(0, 0, model.eye.vertex(2) / 2);
    while (clearance.at(from)->retina.distance > 2.6e-3) from.z() -= 0.05e-3;
    return {control::Trajectory::glide(from, velocity, 10), 5};
  }
};

// Where the robot will be when the command acts, and not where it was seen.
TEST(ServoControllerModes, TheThesisLawIsKeptOutByWhereItsCommandWillAct) {
  const Descent descent;
  const ReferencePath path = descent.path();
  ServoController controller(descent.model, moded_settings(ControlLaw::pd));
  controller.keep_out(&descent.clearance);
  controller.set_trim(descent.trim, {0, 0, 0});
  std::optional<control::PositionEstimator> own;
  const Vector3d command =
      descent.velocity + controller.drag_at({0, 0, 0}).inverse() * descent.trim;
  int free_steps = 0;
  for (int k = 0; k < 60; ++k) {
    const double time = 5 + 0.05 * k, now = time + 0.08;
    const auto seen = taken_at(time, path.at(time).position);
    const ControlStep step = controller.step(now, seen, path, ControlMode::follow);
    if (!own) {
      own.emplace(controller.tuning()->estimator);
      own->set_before(sinking(controller, descent.model, seen.position));
    }
    ASSERT_TRUE(own->measure(seen));
    const double late = own->at(now)->delay;
    const auto ahead = own->at(now + controller.tuning()->horizon + late);
    control::KeepOut settings;
    settings.margin = descent.clearance.margin();
    settings.rate = 0.25 / controller.tuning()->loop.dead_time();
    const auto kept = control::keep_out(
        settings, *descent.clearance.at(ahead->position, ahead->covariance.topLeftCorner<3, 3>()),
        ahead->disturbance + (1 + ahead->gain) * command);
    ASSERT_EQ(step.kept_out, kept.limited) << k;
    const Vector3d wanted =
        kept.limited ? Vector3d((kept.velocity - ahead->disturbance) / (1 + ahead->gain)) : command;
    // The same force as of a robot that is left alone with it for a trim.
    ServoController released(descent.model, moded_settings(ControlLaw::pd));
    released.set_trim(controller.drag_at(seen.position) * wanted, {0, 0, 0});
    const ControlStep same =
        released.step(now, seen, resting_at(seen.position), ControlMode::leave);
    EXPECT_LT((step.currents - same.currents).norm(), 1e-3) << k << ": A";
    own->command(now, wanted);
    if (kept.limited) break;
    ++free_steps;
  }
  EXPECT_GT(free_steps, 10);
  EXPECT_LT(free_steps, 60);
}

// It sank meanwhile, which no command told of.
TEST(ServoControllerModes, AMarginThatWasAwayForAWhileHoldsAtOnceAgain) {
  const Descent descent;
  const Vector3d high = descent.path().at(5).position;
  ServoController controller(descent.model, moded_settings(ControlLaw::pd));
  bool kept = false;
  for (int k = 0; k <= 38; ++k) {
    controller.keep_out(k < 20 || k > 37 ? &descent.clearance : nullptr);
    const double time = 5 + 0.05 * k;
    const Vector3d seen = high - Vector3d(0, 0, k < 20 ? 0 : 0.1e-3 * (k - 19));
    kept = controller.step(time + 0.08, taken_at(time, seen), resting_at(high), ControlMode::leave)
               .kept_out;
    EXPECT_EQ(kept, k > 37) << k;
  }
}

TEST(ServoControllerModes, ConstantCurrentsAreNotWhatTheMarginMakes) {
  const Descent descent;
  Vector3d low = descent.path().at(5).position;
  while (descent.clearance.at(low)->retina.distance > 0.1e-3) low.z() -= 0.02e-3;
  for (const ControlMode mode : {ControlMode::constant, ControlMode::leave}) {
    ServoController controller(descent.model, moded_settings(ControlLaw::pd));
    controller.keep_out(&descent.clearance);
    bool told = false;
    for (int k = 0; k < 10; ++k)
      told = controller.step(5.08 + 0.05 * k, taken_at(5 + 0.05 * k, low), resting_at(low), mode)
                 .kept_out;
    EXPECT_EQ(told, mode == ControlMode::leave);
  }
}

/// s after the first measurement, when a robot that goes by `gone` (m, since then) towards its
/// target 3 mm aside is first said to stand; nothing: in 14 s never.
struct Told {
  std::optional<double> standing, capped, clamped;
  LoopQuality last;
};
struct Scene {
  std::function<Vector3d(double)> gone = [](double) { return Vector3d(0, 0, 0); };
  ReferencePath path = resting_at({0, 0, 1e-3});
  std::function<ControlMode(int)> mode = [](int) { return ControlMode::follow; };
  std::function<void(ServoController&, int)> before = [](ServoController&, int) {};
  int steps = 280;
};
Told watched(ServoController& controller, const Scene& scene) {
  Told told;
  for (int k = 0; k < scene.steps; ++k) {
    const double time = 5 + 0.05 * k;
    scene.before(controller, k);
    const ControlStep step = controller.step(
        time + 0.05, taken_at(time, Vector3d(-3e-3, 0, 1e-3) + scene.gone(time - 5)), scene.path,
        scene.mode(k));
    if (step.quality.standing && !told.standing) told.standing = time - 5;
    if (step.quality.capped && !told.capped) told.capped = time - 5;
    if (step.quality.clamped && !told.clamped) told.clamped = time - 5;
    told.last = step.quality;
  }
  return told;
}

ControllerSettings fixed_gains() {
  ControllerSettings settings = moded_settings(ControlLaw::estimator);
  settings.proportional = 2;
  settings.max_speed = 2e-3;
  return settings;
}

std::function<Vector3d(double)> at_speed(double speed) {
  return [speed](double time) { return Vector3d(speed * time, 0, 0); };
}

// Asked for at a gain of 2 /s: of a robot 3 mm off its largest speed of 2 mm/s, of one 0.3 mm off
// 0.6 mm/s. One that goes less than a fifth of that stands.
TEST(ServoControllerModes, StandingIsAFifthOfTheSpeedThatIsAskedFor) {
  const auto standing = [](double speed, double off) {
    ServoController controller(moded_model(), fixed_gains());
    Scene scene;
    scene.gone = at_speed(speed);
    // The target keeps its distance by going along: what it does itself is asked for too.
    scene.path = {control::Trajectory::glide({-3e-3 + off, 0, 1e-3}, {speed, 0, 0}, 60), 5};
    scene.steps = 140;
    return watched(controller, scene).standing.has_value();
  };
  // Speed v, feedback f: standing where v < (v + f) / 5, so where v < f / 4.
  EXPECT_TRUE(standing(0.45e-3, 3e-3));
  EXPECT_FALSE(standing(0.55e-3, 3e-3));
  EXPECT_TRUE(standing(0.135e-3, 0.3e-3));
  EXPECT_FALSE(standing(0.165e-3, 0.3e-3));
}

TEST(ServoControllerModes, StandingIsNoFaultOfTheThesisLaw) {
  const RigModel model = model_in_eye();
  const RobotClearance clearance(model, {Vector3d::UnitX(), 0, false, false});
  ServoController controller(model, moded_settings(ControlLaw::pd));
  controller.keep_out(&clearance);
  EXPECT_FALSE(watched(controller, {}).standing);
}

// Looked at every half second, over two seconds and the 2.5 s of a catch.
TEST(ServoControllerModes, WhatARobotDidWhileItWasLeftAloneIsNoAnswerToATarget) {
  const auto told = [](ControlMode mode) {
    ServoController controller(moded_model(), fixed_gains());
    Scene scene;
    scene.mode = [mode](int k) { return k >= 60 && k < 63 ? mode : ControlMode::follow; };
    return watched(controller, scene).standing.value_or(99);
  };
  EXPECT_NEAR(told(ControlMode::follow), 4.75, 0.3);
  EXPECT_NEAR(told(ControlMode::leave), 3.15 + 4.75, 0.3);
  EXPECT_NEAR(told(ControlMode::off), 3.1 + 2.5 + 4.75, 0.4);
}

// From 0.9 mm/s to as much back; it goes on being let alone for the 0.15 s within which the
// velocity has changed, and for a fall's 2.5 s.
TEST(ServoControllerModes, ATargetThatTurnsRoundAtOnceLetsTheRobotBeAsAFallDoes) {
  const auto told = [](double speed, double turns) {
    ServoController controller(moded_model(), fixed_gains());
    Scene scene;
    const Vector3d from(0, 0, 1e-3), to = from + Vector3d(speed * turns, 0, 0),
                                     back = to - Vector3d(speed * 60, 0, 0);
    scene.path = {control::Trajectory::waypoints({from, to, back}, {speed, 10}), 5};
    return watched(controller, scene).standing.value_or(99);
  };
  EXPECT_NEAR(told(0.9e-3, 8), 4.75, 0.3) << "a target that goes on";
  EXPECT_NEAR(told(0.5e-3, 3.02), 4.75, 0.3) << "one whose velocity changes by 1 mm/s";
  const double turned = told(0.9e-3, 3.02);
  EXPECT_GT(turned, 3.02 + 0.15 + 2.5 + 4.43);
  EXPECT_LT(turned, 3.02 + 0.15 + 2.5 + 4.7);
}

TEST(ServoControllerModes, AViewThatWasMovedBeginsTheWatchAnew) {
  ServoController controller(moded_model(), fixed_gains());
  Scene scene;
  scene.before = [](ServoController& one, int k) {
    if (k > 0 && k % 80 == 0) one.view_moved({0, 0, 0});
  };
  EXPECT_FALSE(watched(controller, scene).standing);
}

TEST(ServoControllerModes, WhatIsAskedForOfARobotThatIsLetGoIsNoCap) {
  ServoController controller(moded_model(), fixed_gains());
  Scene scene;
  scene.steps = 100;
  const Told following = watched(controller, scene);
  ASSERT_TRUE(following.capped);
  EXPECT_TRUE(following.last.capped);
  controller.reset();
  scene.mode = [](int k) { return k < 95 ? ControlMode::follow : ControlMode::off; };
  const Told fallen = watched(controller, scene);
  EXPECT_TRUE(fallen.capped);
  EXPECT_FALSE(fallen.last.capped);
}

// The disturbance is held below four sink speeds, 2 mm/s at least: one that is carried off faster.
TEST(ServoControllerModes, ARobotThatSomethingElseMovesIsTold) {
  for (const double speed : {3e-3, 1e-3}) {
    RigModel model = moded_model();
    model.medium.kinematic_viscosity *= 10;
    ServoController controller(model, fixed_gains());
    ASSERT_LT(sinking(controller, model, {0, 0, 0}).norm(), 0.5e-3);
    Scene scene;
    scene.steps = 90;
    scene.gone = [speed](double time) { return Vector3d(3e-3, speed * time - 7e-3, 0); };
    scene.path = {control::Trajectory::glide({0, -7e-3, 1e-3}, {0, speed, 0}, 60), 5};
    EXPECT_EQ(watched(controller, scene).clamped.has_value(), speed > 2e-3);
  }
}

/// Whether an oscillation of 40 um, rms 28 um, once a second, is named within 12 s.
bool named(ServoController& controller, const Matrix3d& covariance,
           const std::function<Vector3d(double)>& axis, double amplitude = 40e-6) {
  bool found = false;
  for (int k = 0; k < 240; ++k) {
    const double time = 5 + 0.05 * k;
    if (axis) controller.set_axis(axis(time - 5));
    const Vector3d off(amplitude * std::sin(2 * M_PI * time), 0, 0);
    const control::PositionMeasurement seen{time, Vector3d(1e-3, 0, 1e-3) + off, covariance};
    const ControlStep step =
        controller.step(time + 0.08, seen, resting_at({1e-3, 0, 1e-3}), ControlMode::follow);
    found = found || step.quality.oscillating;
  }
  return found;
}

// Of three times the noise of one coordinate (control/motion_watch.h).
TEST(ServoControllerModes, TheNoiseOfOneCoordinateIsTheMeanOfThree) {
  const auto oscillates = [](double three_sigma) {
    ServoController controller(moded_model(), moded_settings(ControlLaw::pd));
    const double variance = std::pow(three_sigma / 3, 2);
    return named(controller, Vector3d(1.5, 0.5, 1).asDiagonal() * Matrix3d::Identity() * variance,
                 nullptr);
  };
  EXPECT_TRUE(oscillates(26e-6));
  EXPECT_FALSE(oscillates(31e-6));
}

// 0.2 mm per rad/s.
TEST(ServoControllerModes, HowFastTheAxisIsTurnedIsToldToTheWatch) {
  const Matrix3d covariance = Matrix3d::Identity() * 1e-12;
  const auto oscillates = [&](double rate) {  // rad/s
    ServoController controller(moded_model(), moded_settings(ControlLaw::pd));
    return named(controller, covariance, [rate](double time) {
      return Vector3d(std::cos(rate * time), std::sin(rate * time), 0);
    });
  };
  EXPECT_TRUE(oscillates(0.11));
  EXPECT_FALSE(oscillates(0.17));
}

// A unit vector's product with itself may be more than 1 by rounding, which has no arc cosine.
TEST(ServoControllerModes, AnAxisThatDoesNotTurnHidesNoTurnAndOneThatFlipsHasTurned) {
  Vector3d axis(0, 0, 0);
  for (int k = 1; k < 1000 && !(axis.dot(axis) > 1); ++k)
    axis = Vector3d(std::sin(k), std::cos(3 * k), std::sin(5 * k)).normalized();
  ASSERT_GT(axis.dot(axis), 1);
  const Vector3d across = axis.unitOrthogonal();
  const Matrix3d covariance = Matrix3d::Identity() * 1e-12;
  const auto oscillates = [&](const std::function<Vector3d(double)>& turning, double amplitude) {
    ServoController controller(moded_model(), moded_settings(ControlLaw::pd));
    return named(controller, covariance, turning, amplitude);
  };
  EXPECT_TRUE(oscillates([&](double) { return axis; }, 40e-6));
  EXPECT_FALSE(oscillates(
      [&](double time) -> Vector3d {
        const double angle = 0.17 * std::max(0.0, time - 1);
        return std::cos(angle) * axis + std::sin(angle) * across;
      },
      40e-6));
  // Half a turn within a second, now and then: 0.63 mm rms are none of it.
  const auto flipping = [&](double time) -> Vector3d {
    return std::fmod(time, 3) < 1.5 ? axis : Vector3d(-axis);
  };
  EXPECT_FALSE(oscillates(flipping, 0.8e-3));
  EXPECT_TRUE(oscillates(flipping, 1e-3));
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
