// Contract suite of Stage and RotationStage: the duties of the roles, checked alike on emulators
// and real instruments.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/roles/rotation_stage.h"
#include "devices/roles/stage.h"

#include <functional>
#include <string>
#include <vector>

namespace vitreo::contract {

struct StageCheck {
  /// m, where it goes first, one per axis; empty: the middle of the travel.
  std::vector<double> start{};
  double way = 0;    ///< m, how far it is then moved along each axis; 0: a hundredth of the travel
  double speed = 0;  ///< m/s; 0: the usual one
  double tolerance = 0;  ///< m, between target and position; 0: four steps of the axis
  bool home = false;     ///< home it first
  Time timeout = std::chrono::seconds(60);  ///< of each motion
  /// Where it really is, in m, where it can be known (an emulator, a second instrument); else null.
  std::function<std::vector<double>()> measured{};
};

/// Moves the stage through its duties and leaves it standing. Returns one sentence for each duty
/// that it fails; none is good. Lets Stopped pass; takes every other exception as a finding.
/// Motions must last 0.1 s or more: choose `way`.
std::vector<std::string> check(Stage& stage, Clock& clock, const StageCheck& how = {});
/// The same, in rad.
std::vector<std::string> check(RotationStage& stage, Clock& clock, const StageCheck& how = {});

}  // namespace vitreo::contract
