// Calibration of one simulated machine's field by its robot's own motion, without devices, and what
// it buys: force and direction of the field over the workspace, and the loops' errors.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/field_identification.h"
#include "tests/bench/machines/machine_loop.h"

#include <Eigen/Core>

#include <optional>
#include <string>

namespace vitreo::machines {

/// A model's errors over a grid of the workspace, at currents that it allocates for a hold.
struct FieldErrors {
  double drift = 0;          // m/s, rms over the places: what the robot does that is to stand
  double direction = 0;      // rad, rms over places and directions of the true field's
  double largest = 0;        // rad
  double steep = 0;          // rad, rms, of directions pitched by 60 degrees and more
  double steep_largest = 0;  // rad
};

/// The true machine (cores linear, coils cold) against a model; fields of `field` T.
FieldErrors field_errors(const MachineSetting& setting, const RigModel& model, double field);

struct FieldMachine {
  std::string failure;
  std::optional<control::FieldIdentification> found;
  Belief belief;        // that follows
  double duration = 0;  // s
};

/// The robot goes through the workspace with its axis along several directions, under the law
/// estimator; each stretch under a loop of its own.
FieldMachine calibrate_field(const MachineSetting& setting);

}  // namespace vitreo::machines
