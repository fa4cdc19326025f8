// Run status: tier of a requested end, phase, and what a run waits for and has done.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace vitreo {

/// How a run is ended. stop: the script's clean-up, then the safe state; abort: the safe state now,
/// then a short clean-up; emergency: the safe state, even by force, and no clean-up.
enum class StopTier : int { none = 0, stop, abort, emergency };
const char* to_string(StopTier tier);

enum class RunPhase {
  running,
  pause_requested,
  paused,
  suspended,
  stop_requested,
  stopping,
  not_responding,
  ready,  // of the prompt, between two statements: what it has left running goes on
  ended
};
const char* to_string(RunPhase phase);  // "stop requested", ...

struct RunStatus {
  RunPhase phase = RunPhase::running;
  StopTier tier = StopTier::none;
  std::string waiting_for;  // what the script waits for: "servo:go_to"; empty while it computes
  std::string note;         // why: "coil temperature above 80 degC", "paused at before place 3"
  double progress = 0;      // of the whole, 0 to 1, as the script reports it
  std::string doing;        // label of the present step, as the script reports it
  double remaining = -1;    // s of wall time at the pace so far; negative: not known yet
};

/// "stopping, waiting for servo:go_to".
std::string to_string(const RunStatus& status);

}  // namespace vitreo
