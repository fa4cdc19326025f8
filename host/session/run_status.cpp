// SPDX-License-Identifier: Apache-2.0
#include "host/session/run_status.h"

namespace vitreo {

const char* to_string(StopTier tier) {
  switch (tier) {
    case StopTier::none:
      return "none";
    case StopTier::stop:
      return "stop";
    case StopTier::abort:
      return "abort";
    case StopTier::emergency:
      return "emergency stop";
  }
  return "?";
}

const char* to_string(RunPhase phase) {
  switch (phase) {
    case RunPhase::running:
      return "running";
    case RunPhase::pause_requested:
      return "pause requested";
    case RunPhase::paused:
      return "paused";
    case RunPhase::suspended:
      return "suspended";
    case RunPhase::stop_requested:
      return "stop requested";
    case RunPhase::stopping:
      return "stopping";
    case RunPhase::not_responding:
      return "not responding";
    case RunPhase::ready:
      return "ready";
    case RunPhase::ended:
      return "ended";
  }
  return "?";
}

std::string to_string(const RunStatus& status) {
  std::string text = to_string(status.phase);
  if (status.tier > StopTier::stop) text += std::string(" (") + to_string(status.tier) + ")";
  if (!status.note.empty()) text += ": " + status.note;
  if (!status.waiting_for.empty() && status.phase != RunPhase::ended)
    text += ", waiting for " + status.waiting_for;
  return text;
}

}  // namespace vitreo
