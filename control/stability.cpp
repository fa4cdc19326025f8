// SPDX-License-Identifier: Apache-2.0
#include "control/stability.h"

#include "control/preconditions.h"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>

namespace vitreo::control {

// The robot turns into the field within milliseconds (facts/magnetics 3.1), so the axis is taken as
// algebraic.
Eigen::Vector3d force_along_field(const Robot& robot, const FieldGradient& made) {
  const double strength = made.head<3>().norm();
  if (!(strength > 0)) return Eigen::Vector3d::Zero();
  const Eigen::Vector3d moment = robot.moment(strength) / strength * made.head<3>();
  return force_from_field(moment) * made;
}

Eigen::Vector3d force_at(const FieldModel& field, const Robot& robot, const Medium& medium,
                         const Currents& currents, const Eigen::Vector3d& position) {
  require(currents.size() == field.coils(), "currents: one a coil is wanted");
  const FieldGradient made = field.matrix(position) * currents + field.background(position);
  return Eigen::Vector3d(0, 0, -robot.net_weight(medium)) + force_along_field(robot, made);
}

// Linearized about `position` the overdamped robot obeys p' = R^-1 (dF/dp) dp. Earnshaw's theorem:
// at constant currents the trace of dF/dp is at least 0 (facts/magnetics 2.1), so not all
// eigenvalues are negative.
// 1/s: the rate at which a small displacement grows fastest; 0 without currents.
double instability(const FieldModel& field, const Robot& robot, const Medium& medium,
                   const Currents& currents, const Eigen::Vector3d& position) {
  constexpr double kStep = 0.1e-3;  // m: the field varies by 2 % a millimeter
  Eigen::Matrix3d stiffness;        // dF_i/dp_j
  for (int axis = 0; axis < 3; ++axis) {
    // Central differences: the moment's own change with the field is in them.
    const Eigen::Vector3d step = kStep * Eigen::Vector3d::Unit(axis);
    stiffness.col(axis) = (force_at(field, robot, medium, currents, position + step) -
                           force_at(field, robot, medium, currents, position - step)) /
                          (2 * kStep);
  }
  if (currents.isZero()) return 0;
  const Eigen::Vector3d along =
      (field.matrix(position) * currents + field.background(position)).head<3>().normalized();
  const Eigen::Matrix3d rate = resistance(robot, medium, along).inverse() * stiffness;
  return Eigen::EigenSolver<Eigen::Matrix3d>(rate, false).eigenvalues().real().maxCoeff();
}

}  // namespace vitreo::control
