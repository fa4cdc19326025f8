// Servo controller: measurements passed over, limits of the currents, settings refused.
// SPDX-License-Identifier: Apache-2.0
#include "control/robots.h"
#include "host/servo/servo_controller.h"

#include <Eigen/Core>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <stdexcept>
#include <string>
#include <vector>

namespace vitreo {
namespace VITREO_TEST_FILE {

using Eigen::Matrix3d;
using Eigen::Vector3d;
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();

RigModel general_model(const control::Robot& robot) {
  RigModel model;
  model.robot = robot;
  model.field.set_uniform_background({31e-6, -22e-6, 147e-6});
  model.medium.density = 960;
  model.medium.kinematic_viscosity = 420e-6;
  return model;
}

ControllerSettings general_settings(ControlLaw law) {
  ControllerSettings settings;
  settings.law = law;
  settings.field = 12e-3;
  settings.axis = Vector3d(0.6, -0.5, 0.3).normalized();
  settings.limits << 11, 9, 12, 14, 0, 13, 15, 10;  // the fifth coil is dead
  settings.total_limit = 55;
  settings.gains = {1.1, 0.3, 0.15, 3e-3, 0.4};
  settings.velocity = {0.7, 1e-3, 0.2, 0.11, 150e-6};
  return settings;
}

control::PositionMeasurement measured(double time, const Vector3d& position) {
  return {time, position, Matrix3d::Identity() * 2e-11};
}

ReferencePath general_path() {
  return {
      control::Trajectory::line({1e-3, -0.5e-3, 1.2e-3}, {3e-3, -2.5e-3, 2.2e-3}, {0.5e-3, 2e-3}),
      5.2};
}

/// Field and force besides the weight that currents make, entry by entry.
struct Made {
  Vector3d field{0, 0, 0};
  Vector3d force{0, 0, 0};
};
Made made_by(const RigModel& model, const Vector3d& axis, const control::Currents& currents,
             const Vector3d& position) {
  const control::FieldMatrix matrix = model.field.matrix(position);
  control::FieldGradient all = model.field.background(position);
  for (int row = 0; row < 8; ++row)
    for (int coil = 0; coil < currents.size(); ++coil)
      all[row] += matrix(row, coil) * currents[coil];
  Made made;
  made.field = all.head<3>();
  const double xx = all[3];
  const double xy = all[4];
  const double xz = all[5];
  const double yy = all[6];
  const double yz = all[7];
  const Vector3d m = model.robot.moment(made.field.norm()) * axis;
  made.force[0] = m[0] * xx + m[1] * xy + m[2] * xz;
  made.force[1] = m[0] * xy + m[1] * yy + m[2] * yz;
  made.force[2] = m[0] * xz + m[1] * yz - m[2] * (xx + yy) - model.robot.net_weight(model.medium);
  return made;
}

TEST(ServoControllerLimitsReference, what_is_no_measurement_is_passed_over) {
  const RigModel model = general_model(control::coni_2mm());
  const ReferencePath path = general_path();
  for (const ControlLaw law : {ControlLaw::pd, ControlLaw::velocity, ControlLaw::estimator}) {
    const ControllerSettings settings = general_settings(law);
    ServoController controller(model, settings);
    ServoController undisturbed(model, settings);
    const Vector3d position(1e-3, -0.5e-3, 1.1e-3);
    const auto good = [&](double time) {
      return measured(time, position + Vector3d(1e-5, 2e-5, -1e-5) * (time - 5));
    };
    for (ServoController* each : {&controller, &undisturbed})
      each->step(5.4, good(5.3), path, ControlMode::follow);
    std::vector<control::PositionMeasurement> bad(6, good(5.39));
    bad[0].position[1] = kNan;
    bad[1].position[2] = -kInfinity;
    bad[2].time = kNan;
    bad[3].time = 5.3;  // no later than the one before
    bad[4].time = 5.29;
    bad[5].time = kInfinity;
    for (std::size_t k = 0; k < bad.size(); ++k) {
      const ControlStep step = controller.step(5.45, bad[k], path, ControlMode::follow);
      EXPECT_TRUE(step.passed_over) << k;
      EXPECT_EQ(step.currents.size(), law == ControlLaw::estimator ? 8 : 0) << k;
    }
    if (law == ControlLaw::estimator) continue;  // which went on by prediction, and commanded
    const ControlStep after = controller.step(5.5, good(5.41), path, ControlMode::follow);
    const ControlStep wanted = undisturbed.step(5.5, good(5.41), path, ControlMode::follow);
    EXPECT_FALSE(after.passed_over);
    EXPECT_EQ(after.currents, wanted.currents);
  }
}

TEST(ServoControllerLimitsReference, a_robot_that_nothing_can_levitate_is_an_error) {
  const RigModel model = general_model(control::ndfeb_cylinder_1mm());
  ControllerSettings settings = general_settings(ControlLaw::pd);
  settings.limits *= 0.01;
  ServoController controller(model, settings);
  EXPECT_THROW(
      controller.step(5.4, measured(5.3, {1e-3, 0, 1e-3}), general_path(), ControlMode::leave),
      std::domain_error);
}

// A limit that cuts the field of a soft robot takes its moment as well: the levitation is to be
// held with the moment of the field that is left. Where no field that is left levitates it is an
// error.
TEST(ServoControllerLimitsReference, a_soft_robot_is_levitated_by_the_field_that_is_left) {
  const RigModel model = general_model(control::coni_2mm());
  const Vector3d position(1.1e-3, -0.7e-3, 0.9e-3);
  int levitated = 0;
  int cut = 0;
  int refused = 0;
  for (double limit = 0.6; limit < 4; limit += 0.05) {
    ControllerSettings settings = general_settings(ControlLaw::pd);
    settings.limits.setConstant(limit);
    ServoController controller(model, settings);
    try {
      const ControlStep step =
          controller.step(5.4, measured(5.3, position), general_path(), ControlMode::leave);
      const Made made = made_by(model, settings.axis, step.currents, position);
      // At most a fifth of the weight is lacking, and only at a limit.
      const double lacking = -made.force[2] / model.robot.net_weight(model.medium);
      EXPECT_LT(std::abs(lacking), step.limited ? 0.21 : 0.01) << limit;
      cut += step.limited ? 1 : 0;
      ++levitated;
    } catch (const std::domain_error&) {
      EXPECT_EQ(levitated, 0) << limit;  // what a lower limit holds a higher one holds
      ++refused;
    }
  }
  EXPECT_GT(levitated, cut);
  EXPECT_GT(cut, 0);
  EXPECT_GT(refused, 0);
}

TEST(ServoControllerLimitsReference,
     where_a_limit_cuts_the_field_the_moment_left_is_allocated_for) {
  const RigModel model = general_model(control::coni_2mm());
  const Vector3d position(1.1e-3, -0.7e-3, 0.9e-3);
  ControllerSettings settings = general_settings(ControlLaw::pd);
  settings.total_limit = 200;
  settings.limits.setConstant(3.62);
  settings.limits[6] = 4.62;
  ServoController controller(model, settings);
  const ControlStep step =
      controller.step(5.4, measured(5.3, position), general_path(), ControlMode::leave);
  EXPECT_TRUE(step.limited);
  EXPECT_NEAR(step.headroom, 0, 1e-9);
  const Made made = made_by(model, settings.axis, step.currents, position);
  EXPECT_LT(made.field.norm(), 0.95 * settings.field);
  EXPECT_NEAR(made.force[2] / model.robot.net_weight(model.medium), 0, 0.01);
}

// Headroom and field of a step are those of its currents: without any, 1 and 0.
TEST(ServoControllerLimitsReference, without_currents_all_headroom_is_there) {
  const RigModel model = general_model(control::coni_2mm());
  ServoController controller(model, general_settings(ControlLaw::pd));
  const ControlStep off =
      controller.step(5.4, measured(5.3, {1e-3, 0, 1e-3}), general_path(), ControlMode::off);
  EXPECT_EQ(off.headroom, 1);
  EXPECT_EQ(off.field, 0);
}

std::string refusal(ControlLaw law, const std::function<void(ControllerSettings&)>& change) {
  const RigModel model = general_model(control::coni_2mm());
  ControllerSettings settings = general_settings(law);
  change(settings);
  try {
    const ServoController controller(model, settings);
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "";
}

TEST(ServoControllerLimitsReference, settings_are_refused_by_their_name) {
  using S = ControllerSettings;
  for (const ControlLaw law : {ControlLaw::pd, ControlLaw::estimator, ControlLaw::velocity}) {
    EXPECT_EQ(refusal(law, [](S&) {}), "");
    for (const double bad : {0.0, -1.0, kNan}) {
      EXPECT_EQ(refusal(law, [&](S& s) { s.period = bad; }), "period: must be above 0 s");
      EXPECT_EQ(refusal(law, [&](S& s) { s.total_limit = bad; }), "total_limit: must be above 0 A");
    }
    for (const double bad : {0.0, kNan, kInfinity})
      EXPECT_EQ(refusal(law, [&](S& s) { s.axis *= bad; }), "axis: must be finite and not zero");
    for (const double bad : {-1e-9, kNan})
      for (const int coil : {0, 7})
        EXPECT_EQ(refusal(law, [&](S& s) { s.limits[coil] = bad; }),
                  "limits: must be at least 0 A");
    EXPECT_EQ(refusal(law, [](S& s) { s.limits.setZero(); }), "limits: every coil is dead");
    EXPECT_EQ(refusal(law, [](S& s) { s.limits = control::CurrentLimits::Constant(7, 12); }),
              "limits: one a coil is wanted");
    EXPECT_EQ(refusal(law, [](S& s) { s.gains.proportional = -1; }),
              "proportional: must be at least 0 1/s");
    EXPECT_EQ(refusal(law, [](S& s) { s.velocity.integral = 0; }), "integral: must be above 0 N/m");
  }
}

// "Throws std::invalid_argument naming the setting."
TEST(ServoControllerLimitsReference, settings_that_make_no_sense_are_refused) {
  using S = ControllerSettings;
  const ControlLaw law = ControlLaw::estimator;
  for (const double bad : {0.0, -1e-3, kInfinity})
    EXPECT_EQ(refusal(law, [&](S& s) { s.field = bad; }).substr(0, 6), "field:") << bad;
  EXPECT_EQ(refusal(law, [](S& s) { s.field = kNan; }).substr(0, 6), "field:");
  for (const double bad : {-1e-3, 1e-3, kNan, kInfinity})
    EXPECT_NE(refusal(law, [&](S& s) { s.field_max = bad; }), "") << bad;
  for (const double bad : {-1.0, kNan, kInfinity}) {
    EXPECT_NE(refusal(law, [&](S& s) { s.tone = bad; }), "") << bad;
    EXPECT_NE(refusal(law, [&](S& s) { s.proportional = bad; }), "") << bad;
    EXPECT_NE(refusal(law, [&](S& s) { s.max_speed = bad; }), "") << bad;
  }
  for (const double bad : {0.0, -1.0, kNan, kInfinity})
    EXPECT_EQ(refusal(law, [&](S& s) { s.total_limit = bad; }).substr(0, 12), "total_limit:")
        << bad;
  EXPECT_EQ(refusal(law, [](S& s) { s.total_limit = 0.5; }), "");
  EXPECT_NE(refusal(law, [](S& s) { s.period = kInfinity; }), "");
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
