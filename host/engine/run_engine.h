// One run from request to end record: checks, opens, runs, makes safe, closes; the order of births
// and deaths is read here.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/engine/watchdog.h"
#include "host/rig/open_rig.h"
#include "host/session/script_engine.h"
#include "host/session/session.h"
#include "host/view/live_view.h"

#include <cstdint>
#include <functional>
#include <iosfwd>
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

struct RunRequest {
  std::string protocol_file, rig_file;
  std::vector<std::string> arguments;  // "name=value"
  std::uint64_t seed = 1;
  std::string out = "runs";  // the folder in which the run's folder is made
  Pace pace = Pace::as_fast_as_possible;
  std::string operator_name;
  std::vector<std::string>
      frames;  // cameras whose frames are recorded: "top_camera", "side_camera/5"
  std::vector<std::string>
      answers;  // to the questions of the script: "name=value", or "value" in their order
  WatchdogLimits watchdog;
  bool control_socket = false;  // offer one: see host/view/control_socket.h
  SimulationShifts shifts;      // tests only
  std::string override_reason;  // a researcher's, to run although the preflight fails; empty: none
  std::vector<std::string>
      faults;  // of simulated instruments, from the run's begin: see host/session/faults.h
  std::function<void(Session&)> companion =
      {};                  // called before the script; what disturbs a run on purpose
  view::ViewRequest view;  // a page in the browser that shows the run
};

struct RunResult {
  Outcome outcome = Outcome::completed;
  ExitCode exit_code = ExitCode::completed;
  std::string reason;  // empty when completed
  std::string folder;
  std::vector<StatedResult> results;
};

/// Runs a protocol. What is wrong with the request throws before anything is opened or written:
/// ScriptError, ConfigError; RightError; on a laboratory rig PreflightError; DeviceError when the
/// rig does not open. From then on every outcome is in the result and in the run's end record, and
/// the outputs are at zero. `inspect`, for tests, is called with the record and the rig after the
/// run was made safe.
using Inspect = std::function<void(const Recorder&, OpenRig&)>;
RunResult run_protocol(ScriptEngine& engine, const RunRequest& request, ProgressListener& listener,
                       const Inspect& inspect = nullptr);

/// A prompt on a rig, recorded as a run of its own. Returns when `in` ends.
RunResult run_prompt(ScriptEngine& engine, const RunRequest& request, ProgressListener& listener,
                     LineEditor& in, std::ostream& out, std::ostream& err);

/// {"outcome": ..., "run": ..., "results": {...}}, SI.
nlohmann::json to_json(const RunResult& result);

/// Versions of the program and of what it is built on.
nlohmann::json versions();

}  // namespace vitreo
