// What is looked at before anything is energized: the request against the protocol and the rig, and
// a dry run of the same script on the rig's simulated twin.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/engine/run_engine.h"
#include "host/rig/twin.h"

#include <nlohmann/json.hpp>

#include <functional>
#include <map>
#include <stdexcept>
#include <string>
#include <vector>

namespace vitreo {

/// A request that fits its protocol and its rig, as far as both say.
struct CheckedRequest {
  ProtocolDescription protocol;
  std::map<std::string, ArgumentValue> arguments;
  RigDescription rig;
};

/// Parameters against their ranges, the rig file against its bounds, the roles that the protocol
/// needs, the cameras that are to be recorded. Opens and writes nothing. Throws ScriptError,
/// ConfigError.
CheckedRequest check_request(ScriptEngine& engine, const RunRequest& request);

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

struct PreflightLimits {
  double wall = 10;  // s, then it is "not fully simulated"
  /// What to do when the script sits in a call that nothing can interrupt, so that the dry run
  /// cannot be left; must not return. The default says so on the standard error and ends the
  /// process with ExitCode::not_responding.
  std::function<void(const PreflightReport&)> stuck;
};

/// The dry run, on the virtual clock, in a folder of its own that goes. Throws only what is no
/// fault of the script's; Stopped when the operator stopped it.
PreflightReport rehearse(ScriptEngine& engine, const RunRequest& request,
                         const CheckedRequest& checked, const PreflightLimits& limits = {});

/// Both, for `vitreo check`; what check_request throws goes on.
PreflightReport preflight(ScriptEngine& engine, const RunRequest& request,
                          const PreflightLimits& limits = {});

/// As people read it, a line each; and SI.
std::string to_text(const PreflightReport& report);
nlohmann::json to_json(const PreflightReport& report);

/// A run that was refused because its preflight failed.
class PreflightError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

}  // namespace vitreo
