// Preflight report: findings of the checks and of the dry run before a run.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/engine/loop_rate.h"
#include "host/rig/twin.h"

#include <nlohmann/json.hpp>

#include <string>
#include <vector>

namespace vitreo {

struct PreflightReport {
  std::vector<std::string> problems;  // each alone is enough to refuse the run
  std::vector<std::string> warnings;
  std::vector<std::string> not_looked_at;  // of a rig with real instruments
  bool simulated = false;                  // the dry run came to the script's end
  double duration = 0;                     // s of the rig's time that the run takes at least
  CoilUse coils;                           // peak currents and time energized
  std::vector<AxisUse> moves;              // travel of each axis that moves
  LoopRate loop;                           // that the links of the rig can hold
  double frame_bytes_per_second = 0;       // of the frames that are to be recorded
  double disk_bytes = 0;                   // that the run needs at least
  double arguments_time = 0;               // s of wall time: the checks of the request
  double wall_time = 0;                    // s of wall time: the dry run
  bool passed() const { return problems.empty(); }
};

/// A line each, in display units.
std::string to_text(const PreflightReport& report);
/// In SI.
nlohmann::json to_json(const PreflightReport& report);

}  // namespace vitreo
