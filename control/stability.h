// Force on a robot that lies along the field, and its Earnshaw instability in constant currents.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/field_model.h"
#include "control/robot.h"

#include <Eigen/Core>

namespace vitreo::control {

/// Force (N, world) of a field on a robot whose moment m lies along it: F = (m . grad) B. The
/// weight is not in it.
Eigen::Vector3d force_along_field(const Robot& robot, const FieldGradient& made);

/// Force (N, world) of constant currents on a robot at `position` whose axis lies along the field
/// there, weight included.
Eigen::Vector3d force_at(const FieldModel& field, const Robot& robot, const Medium& medium,
                         const Currents& currents, const Eigen::Vector3d& position);

/// The largest real part of the eigenvalues of R^-1 dF/dp, 1/s: displaced a little, the robot's
/// distance grows by e in one over this. Negative where it comes back. The moment turns and grows
/// with the field. Central differences over 0.1 mm, so that a model's region must reach as far.
/// Throws as FieldModel::matrix; std::invalid_argument for currents that are not one a coil.
double instability(const FieldModel& field, const Robot& robot, const Medium& medium,
                   const Currents& currents, const Eigen::Vector3d& position);

}  // namespace vitreo::control
