// Report of a preflight: what a run would do, and what speaks against it.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/rig/twin.h"

#include <nlohmann/json.hpp>

#include <string>
#include <vector>

namespace vitreo {

struct PreflightReport {
  std::vector<std::string> problems;  // each alone is enough to refuse the run
  std::vector<std::string> warnings;
  bool simulated = false;                    // the dry run came to the script's end
  double duration = 0;                       // s of the rig's time that the run takes at least
  CoilUse coils;                             // what it would energize
  std::vector<AxisUse> moves;                // and move
  double frame_bytes_per_second = 0;         // of the frames that are to be recorded
  double disk_bytes = 0;                     // that the run needs at least
  double arguments_time = 0, wall_time = 0;  // s of wall time that the checks took
  bool passed() const { return problems.empty(); }
};

/// As people read it, a line each; and SI.
std::string to_text(const PreflightReport& report);
nlohmann::json to_json(const PreflightReport& report);

}  // namespace vitreo
