// Studies of the benchmark beside the laws: identification of the robot, and the loop watch.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "tests/bench/machines/machine_loop.h"

namespace vitreo::machines {

/// From +-30 % wrong of drag and moment: errors of what is found, and the square after it.
void identify(const MachineSetting& setting, std::uint64_t first, int count);
/// How soon a coil is named of whose current only `part` flows on: each coil on `count` machines.
void watch(const MachineSetting& setting, double part, std::uint64_t first, int count);
/// The thesis' PD with gains about its margin: which machines are in a limit cycle, by the true
/// place after a minute, and how soon the watch names those and the others.
void cycles(const MachineSetting& setting, std::uint64_t first, int count);
/// Alarms of healthy machines: each holds for ten minutes and goes round ten squares.
void false_alarms(const MachineSetting& setting, std::uint64_t first, int count);

/// Calibration of the field by the robot's own motion, and what it buys.
void field_study(const MachineSetting& setting, std::uint64_t first, int count);
}  // namespace vitreo::machines
