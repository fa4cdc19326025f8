// Result of a run: its outcome, and the program's exit code for it.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/record/run_data.h"
#include "host/session/run_control.h"

#include <nlohmann/json.hpp>

#include <functional>
#include <string>
#include <vector>

namespace vitreo {

/// Exit codes of the program; docs/conventions.md lists them.
enum class ExitCode {
  completed = 0,
  script_error = 1,
  usage = 2,
  stopped = 3,
  aborted = 4,
  internal = 5,
  not_responding = 6,
  device_missing = 7,
  preflight_failed = 8  // nothing was opened
};

/// How a run ended, and why.
struct Verdict {
  Outcome outcome = Outcome::completed;
  ExitCode exit_code = ExitCode::completed;
  std::string reason;  // empty when completed
  EndCause cause{"protocol"};
};
/// "stopped: by the operator".
std::string to_string(const Verdict& verdict);
/// Runs `body` and says what its exception means for the run.
Verdict judge(const std::function<void()>& body, const RunControl& control);

struct RunResult {
  Outcome outcome = Outcome::completed;
  ExitCode exit_code = ExitCode::completed;
  std::string reason;  // empty when completed
  std::string folder;
  std::vector<StatedResult> results;
};

/// {"outcome": ..., "run": ..., "results": {...}}, SI.
nlohmann::json to_json(const RunResult& result);

}  // namespace vitreo
