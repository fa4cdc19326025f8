// Servo controller, laws pd and velocity: field and force that its currents make, by plain loops.
// SPDX-License-Identifier: Apache-2.0
#include "control/robots.h"
#include "host/servo/servo_controller.h"

#include <Eigen/Core>
#include <Eigen/LU>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <exception>
#include <numeric>
#include <optional>

namespace vitreo {
namespace VITREO_TEST_FILE {

using Eigen::Matrix3d;
using Eigen::Vector3d;

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

void expect_made(const RigModel& model, const ControllerSettings& settings, const ControlStep& step,
                 const Vector3d& position, const Vector3d& force) {
  ASSERT_EQ(step.currents.size(), 8);
  const Made made = made_by(model, settings.axis, step.currents, position);
  EXPECT_LT((made.field - settings.field * settings.axis).norm(), 1e-12);
  EXPECT_LT((made.force - force).norm(), 1e-15)
      << made.force.transpose() << " for " << force.transpose();
  EXPECT_EQ(step.field, settings.field);
  double headroom = 1;
  for (int coil = 0; coil < 8; ++coil)
    if (settings.limits[coil] > 0)
      headroom = std::min(headroom, 1 - std::abs(step.currents[coil]) / settings.limits[coil]);
    else
      EXPECT_EQ(step.currents[coil], 0);
  EXPECT_NEAR(step.headroom, headroom, 1e-12);
  EXPECT_FALSE(step.limited || step.outside || step.passed_over || step.kept_out);
  EXPECT_FALSE(step.at_bound || step.inconsistent);
}

TEST(ServoControllerReference, pd_makes_the_field_and_the_force_of_its_velocity) {
  for (const control::Robot& robot : {control::coni_2mm(), control::ndfeb_cylinder_1mm()}) {
    const RigModel model = general_model(robot);
    const ControllerSettings settings = general_settings(ControlLaw::pd);
    ServoController controller(model, settings);
    const Vector3d trim(2e-7, -3e-7, 5e-7);
    controller.set_trim(trim, {1e-3, 2e-3, -1e-3});
    EXPECT_EQ(controller.trim(), trim);
    control::PdController pd(settings.gains);
    const ReferencePath path = general_path();
    const Matrix3d drag = control::resistance(robot, model.medium, settings.axis);
    double time = 5.31;
    for (int k = 0; k < 6; ++k) {
      const Vector3d position(1.1e-3 + 2e-5 * k, -0.7e-3 - 1e-5 * k * k, 1.3e-3 - 3e-5 * k);
      const ControlStep step =
          controller.step(time + 0.09, measured(time, position), path, ControlMode::follow);
      // The reference is that of the exposure.
      const control::Reference reference = path.path.at(time - 5.2);
      const Vector3d wanted = pd.update(time, position, reference);
      expect_made(model, settings, step, position, drag * wanted + trim);
      EXPECT_LT((step.correction - (wanted - reference.velocity)).norm(), 1e-15);
      EXPECT_EQ(step.commanded, Vector3d(0, 0, 0));
      EXPECT_FALSE(step.estimate);
      time += 0.06 + 0.01 * (k % 2);
    }
    const ControlStep nothing =
        controller.step(time + 0.09, std::nullopt, path, ControlMode::follow);
    EXPECT_EQ(nothing.currents.size(), 0);
    EXPECT_FALSE(controller.tuning());
    EXPECT_FALSE(controller.margins());
    EXPECT_EQ(controller.estimator(), nullptr);
    EXPECT_LT((controller.drag_at({1e-3, 0, 2e-3}) - drag).norm(), 1e-18);
    EXPECT_LT(
        (controller.force_of({2e-4, -1e-4, 3e-4}) - drag * Vector3d(2e-4, -1e-4, 3e-4)).norm(),
        1e-20);
  }
}

TEST(ServoControllerReference, the_currents_are_the_least_that_do_it) {
  const RigModel model = general_model(control::coni_2mm());
  const ControllerSettings settings = general_settings(ControlLaw::pd);
  ServoController controller(model, settings);
  const Vector3d position(1.4e-3, -0.9e-3, 0.8e-3);
  const ControlStep step =
      controller.step(5.4, measured(5.31, position), general_path(), ControlMode::leave);
  // Least: no part of them in the null space, so a sum of the rows of field and force.
  const Vector3d m = model.robot.moment(settings.field) * settings.axis;
  const control::FieldMatrix matrix = model.field.matrix(position);
  double rows[6][8] = {};
  for (int coil = 0; coil < 8; ++coil) {
    if (settings.limits[coil] == 0) continue;
    const auto g = matrix.col(coil);
    for (int k = 0; k < 3; ++k) rows[k][coil] = g[k];
    rows[3][coil] = (m[0] * g[3] + m[1] * g[4] + m[2] * g[5]) / m.norm() / 20;
    rows[4][coil] = (m[0] * g[4] + m[1] * g[6] + m[2] * g[7]) / m.norm() / 20;
    rows[5][coil] = (m[0] * g[5] + m[1] * g[7] - m[2] * (g[3] + g[6])) / m.norm() / 20;
  }
  // Gram and Schmidt, twice over for the rounding; then what is left of the currents.
  double left[8];
  for (int coil = 0; coil < 8; ++coil) left[coil] = step.currents[coil];
  const auto take = [](const double* row, double* from) {
    double product = 0;
    for (int coil = 0; coil < 8; ++coil) product += row[coil] * from[coil];
    for (int coil = 0; coil < 8; ++coil) from[coil] -= product * row[coil];
  };
  for (int k = 0; k < 6; ++k) {
    for (int turn = 0; turn < 2; ++turn)
      for (int before = 0; before < k; ++before) take(rows[before], rows[k]);
    const double length = std::sqrt(std::inner_product(rows[k], rows[k] + 8, rows[k], 0.0));
    for (double& entry : rows[k]) entry /= length;
  }
  for (int turn = 0; turn < 2; ++turn)
    for (const auto& row : rows) take(row, left);
  for (const double part : left) EXPECT_LT(std::abs(part), 1e-6);
}

TEST(ServoControllerReference, the_velocity_law_goes_on_from_what_the_limits_left) {
  // A permanent magnet: its moment, and so the force, is the same whatever a limit cuts the field
  // to.
  const RigModel model = general_model(control::ndfeb_cylinder_1mm());
  ControllerSettings settings = general_settings(ControlLaw::velocity);
  settings.velocity = {2.5, 3e-3, 0.15, 0.11, 300e-6};
  settings.limits *= 0.45;
  const Matrix3d drag = control::resistance(model.robot, model.medium, settings.axis);
  ServoController controller(model, settings);
  const Vector3d trim(2e-7, -3e-7, 5e-7);
  controller.set_trim(trim, {0, 0, 0});
  control::VelocityController law(settings.velocity);
  const ReferencePath path = general_path();
  double time = 5.31;
  int limited = 0;
  for (int k = 0; k < 12; ++k) {
    const Vector3d position(-2.1e-3 + 3e-5 * k, 0.9e-3 - 1e-5 * k, 0.3e-3 + 2e-5 * k);
    const ControlStep step =
        controller.step(time + 0.09, measured(time, position), path, ControlMode::follow);
    const control::Reference reference = path.at(time);
    const Vector3d force = law.update(time, position, reference);
    EXPECT_LT((step.correction - (drag.inverse() * force - reference.velocity)).norm(), 1e-12) << k;
    const Made made = made_by(model, settings.axis, step.currents, position);
    if (!step.limited) {
      EXPECT_LT((made.force - trim - force).norm(), 1e-11) << k;
    }
    limited += step.limited ? 1 : 0;
    law.limited_to(made.force - trim);
    time += 0.07;
  }
  EXPECT_GE(limited, 3);
  EXPECT_LE(limited, 10);
}

TEST(ServoControllerReference, modes_without_a_target) {
  const RigModel model = general_model(control::coni_2mm());
  const ReferencePath path = general_path();
  const Vector3d trim(2e-7, -3e-7, 5e-7);
  const Vector3d place(1e-3, 2e-3, -1e-3);
  for (const ControlLaw law : {ControlLaw::pd, ControlLaw::velocity}) {
    const ControllerSettings settings = general_settings(law);
    ServoController controller(model, settings);
    controller.set_trim(trim, place);
    for (int k = 0; k < 3; ++k) {
      const double time = 7 + 0.3 * k;
      const Vector3d position(1.1e-3, -0.6e-3 * k, 0.9e-3);
      expect_made(model, settings,
                  controller.step(time + 0.1, measured(time, position), path, ControlMode::leave),
                  position, trim);
      const auto other = measured(time + 0.1, position);
      expect_made(model, settings, controller.step(time + 0.2, other, path, ControlMode::constant),
                  place, trim);
    }
    EXPECT_EQ(controller.step(8, std::nullopt, path, ControlMode::leave).currents.size(), 0);
    expect_made(model, settings, controller.step(8.1, std::nullopt, path, ControlMode::constant),
                place, trim);
    for (const auto& seen :
         {std::optional(measured(8.2, place)), std::optional<control::PositionMeasurement>()}) {
      const ControlStep off = controller.step(8.3, seen, path, ControlMode::off);
      ASSERT_EQ(off.currents.size(), 8);
      EXPECT_EQ(off.currents.cwiseAbs().maxCoeff(), 0);
    }
    EXPECT_THROW(controller.step(8.6, measured(8.5, place), path, ControlMode::cancel),
                 std::exception);
  }
}

TEST(ServoControllerReference, orienting_currents_and_another_axis) {
  const RigModel model = general_model(control::coni_2mm());
  ControllerSettings settings = general_settings(ControlLaw::pd);
  ServoController controller(model, settings);
  const ReferencePath path = general_path();
  for (const Vector3d& axis : {settings.axis, Vector3d(-0.2, 0.7, 0.4).normalized()}) {
    settings.axis = axis;
    controller.set_axis(axis);
    const Made made = made_by(model, axis, controller.orienting_currents(), {0, 0, 0});
    EXPECT_LT((made.field - settings.field * axis).norm(), 1e-12);
    const double weight = model.robot.net_weight(model.medium);
    EXPECT_LT((made.force + Vector3d(0, 0, weight)).norm(), 1e-15);
    const Vector3d position(0.7e-3, 0.4e-3, -0.3e-3);
    const double time = 6 + axis[1];
    const ControlStep step =
        controller.step(time + 0.1, measured(time, position), path, ControlMode::leave);
    expect_made(model, settings, step, position, Vector3d(0, 0, 0));
    const Matrix3d drag = control::resistance(model.robot, model.medium, axis);
    EXPECT_LT((controller.force_of({1e-3, 2e-3, 3e-3}) - drag * Vector3d(1e-3, 2e-3, 3e-3)).norm(),
              1e-18);
    EXPECT_LT((controller.drag_at(position) - drag).norm(), 1e-18);
  }
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
