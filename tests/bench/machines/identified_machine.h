// Identification of one simulated machine, without devices, as protocols/calibrate_robot.lua does
// it: steps along x and z and falls, lying and upright, in two minutes.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/robot_identification.h"
#include "tests/bench/machines/machine_loop.h"

#include <string>

namespace vitreo::machines {

struct IdentifiedMachine {
  std::string failure;
  control::IdentifiedResponse x, z;       // lying along x: along the axis, across it
  control::IdentifiedFall across, along;  // lying; upright
  // Of the believed ones: sinking speed beside the walls where it fell, across and along.
  control::Identified sink_across, sink_along;
  // True values: s, and factors of the believed sinking speeds.
  double delay = 0;
  double true_across = 1, true_along = 1;
  Belief belief;          // that follows
  double duration = 0;    // s, of it all
  MachineResult watched;  // what the loop watch named meanwhile: falsely, as nothing fails
};

IdentifiedMachine identify_machine(const MachineSetting& setting);

}  // namespace vitreo::machines
