// True state of the simulated laboratory, for records and judging: nothing of a loop is given it.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/coil_field.h"

#include <Eigen/Core>

namespace vitreo::sim {

/// The true state, for the record and the tests. No type of the loop knows it.
struct Truth {
  Eigen::Vector3d position;             // m, world
  Eigen::Vector3d axis;                 // unit, world
  control::Currents currents;           // A, as they flow
  control::Currents coil_temperatures;  // K
  // the robot is outside the region of the plant's calibration: World::beyond_calibration
  bool beyond_calibration = false;
};

/// The coils as they are, whether or not a robot is there.
struct CoilTruth {
  control::Currents set_points;    // A, what the amplifiers were last told
  control::Currents currents;      // A, as they flow
  control::Currents temperatures;  // K
};

}  // namespace vitreo::sim
