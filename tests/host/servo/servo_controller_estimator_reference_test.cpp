// Servo controller, law estimator: its steps against filter, schedule and law put together anew.
// SPDX-License-Identifier: Apache-2.0
#include "control/robots.h"
#include "control/stability.h"
#include "host/servo/servo_controller.h"

#include <Eigen/Core>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <optional>

namespace vitreo {
namespace VITREO_TEST_FILE {

using Eigen::Matrix3d;
using Eigen::Vector3d;
constexpr double kFloor = 0.2e-6;  // m, below the noise of any measurement

RigModel general_model() {
  RigModel model;
  model.robot = control::coni_2mm();
  model.field.set_uniform_background({31e-6, -22e-6, 147e-6});
  model.medium.density = 960;
  model.medium.kinematic_viscosity = 420e-6;
  model.command_delay = 37e-3;
  model.command_bandwidth = 11;
  return model;
}

ControllerSettings general_settings() {
  ControllerSettings settings;
  settings.law = ControlLaw::estimator;
  settings.field = 12e-3;
  settings.axis = Vector3d(0.6, -0.5, 0.3).normalized();
  settings.period = 1 / 21.0;
  return settings;
}

control::PositionMeasurement measured(double time, const Vector3d& position) {
  Matrix3d root;
  root << 4e-6, 0, 0, 1e-6, 3e-6, 0, -2e-6, 1e-6, 7e-6;
  return {time, position, root * root.transpose()};
}

ReferencePath general_path() {
  return {
      control::Trajectory::line({1e-3, -0.5e-3, 1.2e-3}, {3e-3, -2.5e-3, 2.2e-3}, {0.5e-3, 2e-3}),
      5.2};
}

/// A robot that follows the path by and large.
Vector3d somewhere(int k, double time) {
  return general_path().at(time).position +
         Vector3d(1e-5 * (k % 3) - 2e-5, 2e-5 - 1e-5 * (k % 4), 1e-5 * (k % 2));
}

TEST(ServoControllerEstimatorReference, the_tuning_is_that_of_the_loop_at_its_first_measurement) {
  const RigModel model = general_model();
  for (const Vector3d& axis : {general_settings().axis, Vector3d(0, 0.6, -0.8)}) {
    ControllerSettings settings = general_settings();
    settings.axis = axis;
    ServoController controller(model, settings);
    EXPECT_FALSE(controller.tuning());
    EXPECT_EQ(controller.estimator(), nullptr);
    const auto nothing = controller.step(7.1, std::nullopt, general_path(), ControlMode::follow);
    EXPECT_EQ(nothing.currents.size(), 0);
    EXPECT_FALSE(controller.tuning());
    const auto first = measured(7.3, {1e-3, -0.7e-3, 1.1e-3});
    controller.step(7.391, first, general_path(), ControlMode::follow);
    ASSERT_TRUE(controller.tuning());
    EXPECT_NE(controller.estimator(), nullptr);
    const control::LoopIdentity loop = controller.tuning()->loop;
    EXPECT_NEAR(loop.measurement_latency, 0.091, 1e-12);
    EXPECT_EQ(loop.command_delay, 37e-3);
    EXPECT_NEAR(loop.command_lag, 1 / (2 * M_PI * 11), 1e-15);
    EXPECT_EQ(loop.period, settings.period);
    double variance = 0;
    for (int k = 0; k < 3; ++k) variance += first.covariance(k, k) / 3;
    EXPECT_NEAR(loop.noise, std::sqrt(variance + kFloor * kFloor), 1e-15);
    // The least of the three: of what sinks fastest.
    const Matrix3d drag = control::resistance(model.robot, model.medium, axis);
    EXPECT_NEAR(loop.drag, std::min({drag(0, 0), drag(1, 1), drag(2, 2)}), 1e-12);
    EXPECT_EQ(loop.weight, model.robot.net_weight(model.medium));
    // Of the robot left alone at the center, in the currents that levitate it there.
    const FieldAllocator allocator(
        model, {settings.field, settings.field, axis, settings.limits, settings.total_limit, 0});
    EXPECT_NEAR(loop.instability,
                control::instability(model.field, model.robot, model.medium,
                                     allocator.allocate({0, 0, 0}, {0, 0, 0}).currents, {0, 0, 0}),
                1e-9);
    const control::ServoTuning wanted = control::tune(loop);
    EXPECT_EQ(controller.tuning()->horizon, wanted.horizon);
    EXPECT_EQ(controller.tuning()->gains.proportional, wanted.gains.proportional);
    EXPECT_EQ(controller.tuning()->gains.max_speed, wanted.gains.max_speed);
    EXPECT_EQ(controller.tuning()->estimator.disturbance_walk, wanted.estimator.disturbance_walk);
    // Not tuned anew by a second one that comes sooner.
    controller.step(7.44, measured(7.4, first.position), general_path(), ControlMode::follow);
    EXPECT_NEAR(controller.tuning()->loop.measurement_latency, 0.091, 1e-12);
  }
}

/// What a step is to be, with the public parts alone.
struct Reference {
  RigModel model = general_model();
  ControllerSettings settings = general_settings();
  Matrix3d drag = control::resistance(model.robot, model.medium, settings.axis);
  Matrix3d mobility = drag.inverse();
  std::optional<control::PositionEstimator> filter{};
  control::ServoTuning tuning{};
  Vector3d last{0, 0, 0};
  control::PositionEstimate ahead{};
  control::ServoSchedule schedule{};
  Vector3d wanted{0, 0, 0};
  Vector3d reference{0, 0, 0};
  control::PositionEstimate now_estimated{};

  void step(double now, std::optional<control::PositionMeasurement> seen,
            const ReferencePath& path) {
    if (!filter) {
      filter.emplace(tuning.estimator);
      filter->set_before(-model.robot.net_weight(model.medium) * mobility.col(2));  // its fall
    }
    if (seen) {
      seen->covariance += kFloor * kFloor * Matrix3d::Identity();
      ASSERT_TRUE(filter->measure(*seen));
    }
    now_estimated = *filter->at(now);
    const double acts = now + tuning.horizon + now_estimated.delay;
    ahead = *filter->at(acts);
    // The mean velocity for as long as the command will hold.
    reference =
        (path.at(acts + settings.period).position - path.at(acts).position) / settings.period;
    schedule =
        control::schedule(tuning, ahead, {reference.norm(), (ahead.commanded - last).norm()});
    last = ahead.commanded;
    filter->set_disturbance_walk(schedule.disturbance_walk);
    // u = (v_ref + sat(Kp e) - d) / (1 + g), the divisor the cautious one.
    Vector3d feedback = schedule.proportional * (path.at(acts).position - ahead.position);
    if (feedback.norm() > tuning.gains.max_speed)
      feedback *= tuning.gains.max_speed / feedback.norm();
    const double response = 1 + ahead.gain;
    wanted = (reference + feedback - ahead.disturbance) /
             (response + ahead.gain_sigma * ahead.gain_sigma / response);
  }
};

void expect_step(const Reference& wanted, const ControlStep& step, const Vector3d& trim) {
  ASSERT_TRUE(step.estimate);
  const control::PositionEstimate& now = *step.estimate;
  EXPECT_LT((now.position - wanted.now_estimated.position).norm(), 1e-13);
  EXPECT_LT((now.disturbance - wanted.now_estimated.disturbance).norm(), 1e-12);
  EXPECT_NEAR(now.gain, wanted.now_estimated.gain, 1e-10);
  EXPECT_NEAR(now.gain_sigma, wanted.now_estimated.gain_sigma, 1e-10);
  EXPECT_NEAR(now.delay, wanted.now_estimated.delay, 1e-11);
  EXPECT_LT((now.commanded - wanted.now_estimated.commanded).norm(), 1e-12);
  EXPECT_LT((step.correction - (wanted.wanted - wanted.reference - wanted.mobility * trim)).norm(),
            1e-12);
  EXPECT_LT((step.commanded - wanted.wanted).norm(), 1e-12);
  ASSERT_EQ(step.currents.size(), 8);
  // Field and force are those of the place where the robot will be when the currents act.
  const RigModel& model = wanted.model;
  const control::FieldGradient made = model.field.matrix(wanted.ahead.position) * step.currents +
                                      model.field.background(wanted.ahead.position);
  const Vector3d& axis = wanted.settings.axis;
  EXPECT_LT((made.head<3>() - step.field * axis).norm(), 1e-11);
  const Vector3d force = control::gradient_matrix(made) * (model.robot.moment(step.field) * axis) -
                         Vector3d(0, 0, model.robot.net_weight(model.medium));
  EXPECT_LT((force - wanted.drag * wanted.wanted).norm(), 1e-14);
  EXPECT_FALSE(step.limited || step.passed_over || step.outside || step.kept_out);
}

TEST(ServoControllerEstimatorReference, steps_are_those_of_filter_schedule_and_law) {
  Reference reference;
  ServoController controller(reference.model, reference.settings);
  const Vector3d trim(2e-7, -3e-7, 5e-7);
  controller.set_trim(trim, {1e-3, 2e-3, -1e-3});
  const ReferencePath path = general_path();
  double time = 5.3;
  for (int k = 0; k < 20; ++k) {
    const double now = time + 0.091;
    std::optional<control::PositionMeasurement> seen;
    if (k % 7 != 5) seen = measured(time, somewhere(k, time));
    const ControlStep step = controller.step(now, seen, path, ControlMode::follow);
    ASSERT_TRUE(controller.tuning());
    reference.tuning = *controller.tuning();
    reference.step(now, seen, path);
    expect_step(reference, step, trim);
    EXPECT_EQ(step.field, reference.settings.field);
    reference.filter->command(now, step.commanded);
    if (k % 4 == 2) {
      const auto margins = controller.margins();
      ASSERT_TRUE(margins);
      EXPECT_NEAR(margins->schedule.proportional, reference.schedule.proportional, 1e-9);
      EXPECT_NEAR(margins->schedule.bandwidth, reference.schedule.bandwidth, 1e-9);
      EXPECT_NEAR(margins->schedule.disturbance_walk, reference.schedule.disturbance_walk, 1e-14);
      EXPECT_LT((margins->estimate.position - reference.ahead.position).norm(), 1e-13);
    }
    time += 0.047 + 0.004 * (k % 3);
    if (HasFailure()) FAIL() << "step " << k;
  }
}

// A robot that is carried along at 0.3 mm/s: told to stay where it is, it is told what cancels
// that.
TEST(ServoControllerEstimatorReference, to_cancel_is_to_command_against_the_disturbance) {
  Reference reference;
  ServoController controller(reference.model, reference.settings);
  const ReferencePath path = general_path();
  double time = 5.3;
  for (int k = 0; k < 24; ++k, time += 0.05) {
    const ControlMode mode = k < 20 ? ControlMode::follow : ControlMode::cancel;
    const Vector3d carried = 0.3e-3 * (time - 5.3) * Vector3d(0.6, 0, 0.8);
    const auto seen = measured(time, somewhere(k, time) + carried);
    const ControlStep step = controller.step(time + 0.091, seen, path, mode);
    reference.tuning = *controller.tuning();
    reference.step(time + 0.091, seen, path);
    if (mode == ControlMode::cancel) {
      const Vector3d wanted = -reference.ahead.disturbance / (1 + reference.ahead.gain);
      EXPECT_GT(wanted.norm(), 0.05e-3);
      EXPECT_LT((step.commanded - wanted).norm(), 1e-12) << k;
      EXPECT_EQ(step.correction, Vector3d(0, 0, 0));
      break;  // the schedule of a path that stands still is another one from here on
    }
    reference.filter->command(time + 0.091, step.commanded);
  }
}

// "The loop of the direction in which the filter corrects most", with the delay that it found.
TEST(ServoControllerEstimatorReference, its_margins_are_those_of_the_loop_that_is_believed) {
  ServoController controller(general_model(), general_settings());
  EXPECT_FALSE(controller.margins());
  double time = 5.3;
  for (int k = 0; k < 30; ++k, time += 0.05)
    controller.step(time + 0.09, measured(time, somewhere(k, time)), general_path(),
                    ControlMode::follow);
  const auto margins = controller.margins();
  ASSERT_TRUE(margins);
  const control::LoopIdentity known = controller.tuning()->loop;
  const Matrix3d velocity = controller.estimator()->velocity_gain();
  const Eigen::SelfAdjointEigenSolver<Matrix3d> squares(velocity.transpose() * velocity);
  const Vector3d from = squares.eigenvectors().col(2);
  const Vector3d to = (velocity * from).normalized();
  control::SampledLoop loop;
  loop.period = general_settings().period;
  loop.latency = known.measurement_latency;
  ASSERT_NE(margins->estimate.delay, 0);
  loop.command_delay = 37e-3 + margins->estimate.delay;
  loop.command_lag = 1 / (2 * M_PI * 11);
  loop.horizon = loop.command_delay + loop.command_lag;
  loop.proportional = margins->schedule.proportional;
  loop.velocity_gain = std::sqrt(squares.eigenvalues()[2]);
  loop.position_gain = to.dot(controller.estimator()->position_gain() * from);
  const control::LoopMargins wanted = control::loop_margins(loop);
  EXPECT_NEAR(margins->margins.gain_up, wanted.gain_up, 1e-6 * wanted.gain_up);
  EXPECT_NEAR(margins->margins.delay_more, wanted.delay_more, 1e-6);
}

// A robot that goes four times as far as it is told: beyond what the filter lets its gain be.
TEST(ServoControllerEstimatorReference, a_gain_beyond_its_bound_is_told) {
  ServoController controller(general_model(), general_settings());
  Vector3d place = general_path().at(5.3).position;
  double time = 5.3;
  int at_bound = 0;
  for (int k = 0; k < 120; ++k, time += 0.05) {
    const ControlStep step =
        controller.step(time + 0.09, measured(time, place), general_path(), ControlMode::follow);
    ASSERT_NE(controller.estimator(), nullptr);
    EXPECT_EQ(step.at_bound, controller.estimator()->at_bound()) << k;
    at_bound += step.at_bound ? 1 : 0;
    ASSERT_TRUE(step.estimate);
    place += 0.05 * 4 * step.estimate->commanded;
  }
  EXPECT_GT(at_bound, 0);
  EXPECT_LT(at_bound, 120);
}

TEST(ServoControllerEstimatorReference, gain_and_largest_speed_may_be_given) {
  ControllerSettings settings = general_settings();
  settings.proportional = 1.7;
  settings.max_speed = 0.9e-3;
  ServoController controller(general_model(), settings);
  double time = 5.3;
  for (int k = 0; k < 5; ++k, time += 0.05)
    controller.step(time + 0.09, measured(time, somewhere(k, time)), general_path(),
                    ControlMode::follow);
  EXPECT_EQ(controller.tuning()->gains.max_speed, 0.9e-3);
  EXPECT_EQ(controller.margins()->schedule.proportional, 1.7);
}

TEST(ServoControllerEstimatorReference, a_tone_changes_neither_field_nor_force) {
  const RigModel model = general_model();
  ControllerSettings settings = general_settings();
  settings.tone = 0.6;
  ServoController singing(model, settings);
  ServoController silent(model, general_settings());
  double time = 5.3;
  double most = 0;
  for (int k = 0; k < 8; ++k, time += 0.05) {
    const auto seen = measured(time, somewhere(k, time));
    const ControlStep step = singing.step(time + 0.09, seen, general_path(), ControlMode::follow);
    const ControlStep other = silent.step(time + 0.09, seen, general_path(), ControlMode::follow);
    const control::PositionEstimate estimate = *step.estimate;
    EXPECT_LT((estimate.position - other.estimate->position).norm(), 1e-12);
    const control::Currents tone = step.currents - other.currents;
    most = std::max(most, tone.cwiseAbs().maxCoeff());
    EXPECT_LT((step.commanded - other.commanded).norm(), 1e-9);
    // Of the null space where the robot will be, some um from where it is.
    EXPECT_LT((model.field.matrix(estimate.position) * tone).head<3>().norm(), 2e-4 * 12e-3);
  }
  EXPECT_GT(most, 0.1);
  EXPECT_LT(most, 0.6 * 8);
}

TEST(ServoControllerEstimatorReference, reset_forgets_what_was_measured_and_commanded) {
  ServoController controller(general_model(), general_settings());
  const auto run = [&](double begin, double latency) {
    ServoController fresh(general_model(), general_settings());
    for (int k = 0; k < 8; ++k) {
      const double time = begin + 0.05 * k;
      const auto seen = measured(time, somewhere(k, time));
      const ControlStep step =
          controller.step(time + latency, seen, general_path(), ControlMode::follow);
      const ControlStep wanted =
          fresh.step(time + latency, seen, general_path(), ControlMode::follow);
      ASSERT_EQ(step.currents, wanted.currents) << begin << ' ' << k;
      EXPECT_EQ(step.correction, wanted.correction);
      EXPECT_EQ(controller.tuning()->loop.measurement_latency,
                fresh.tuning()->loop.measurement_latency);
    }
    EXPECT_EQ(controller.margins()->innovation, fresh.margins()->innovation);
    EXPECT_EQ(controller.margins()->correlation, fresh.margins()->correlation);
  };
  run(5.3, 0.09);
  controller.reset();
  EXPECT_FALSE(controller.margins());
  EXPECT_EQ(controller.step(6, std::nullopt, general_path(), ControlMode::follow).currents.size(),
            0);
  run(5.25, 0.07);  // earlier times, another latency
}

TEST(ServoControllerEstimatorReference, a_robot_without_currents_is_expected_to_fall) {
  const RigModel model = general_model();
  ServoController controller(model, general_settings());
  const Matrix3d mobility =
      control::resistance(model.robot, model.medium, general_settings().axis).inverse();
  const Vector3d fall = -model.robot.net_weight(model.medium) * mobility.col(2);
  Vector3d position(1e-3, -0.5e-3, 2e-3);
  double time = 5.3;
  for (int k = 0; k < 30; ++k, time += 0.05) {
    const ControlStep step = controller.step(
        time + 0.09, measured(time, position + fall * 0.05 * k), general_path(), ControlMode::off);
    ASSERT_EQ(step.currents.size(), 8);
    EXPECT_EQ(step.currents.cwiseAbs().maxCoeff(), 0);
    ASSERT_TRUE(step.estimate);
    EXPECT_LT((step.estimate->commanded - fall).norm(), 1e-9);
    EXPECT_LT(step.estimate->disturbance.norm(), 1e-6);
  }
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
