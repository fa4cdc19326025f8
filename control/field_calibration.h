// Field calibration of a coil system, and its comparison with another model of the same coils.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/field_model.h"

#include <Eigen/Core>

#include <string>
#include <vector>

namespace vitreo::control {

/// A measured field (MPEM: Petruska & Nelson) under its system's name. The text format is the
/// host's (host/rig/field_calibration_yaml.h).
struct FieldCalibration {
  std::string system_name;  ///< may be empty
  MultipoleField field;
  std::vector<std::string> warnings{};  ///< what a reader corrected, one line each
};

/// One coil of two models: its field per ampere is b in the one and b0 in the reference.
struct CoilComparison {
  int sign = 1;      ///< -1 where b . b0 < 0: wired, or counted, the other way round
  double gain = 0;   ///< |b| / |b0|; not finite where the reference makes no field
  double angle = 0;  ///< rad, 0 to pi/2, between the axes sign * b and b0
};

/// One entry a coil, at a position (m, world) where both models hold. Throws std::invalid_argument
/// where the numbers of coils differ, and what FieldModel::matrix throws.
std::vector<CoilComparison> compare_coils(const FieldModel& model, const FieldModel& reference,
                                          const Eigen::Vector3d& position_in_world);

}  // namespace vitreo::control
