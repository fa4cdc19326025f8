// Run engine: one run from request to end record, in a straight line: check, rehearse, prepare,
// open, conduct.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/engine/conduct.h"
#include "host/engine/request.h"
#include "host/engine/run_result.h"
#include "host/session/script_engine.h"

#include <iosfwd>

namespace vitreo {

/// Runs a protocol. What is wrong with the request throws before anything is opened or written:
/// ScriptError, ConfigError; RightError; on a laboratory rig PreflightError; DeviceError when the
/// rig does not open. From then on every outcome is in the result and in the run's end record, and
/// the outputs are at zero.
RunResult run_protocol(ScriptEngine& engine, const RunRequest& request, ProgressListener& listener,
                       const Inspect& inspect = nullptr);

/// A prompt on a rig, recorded as a run of its own. Returns when `in` ends.
RunResult run_prompt(ScriptEngine& engine, const RunRequest& request, ProgressListener& listener,
                     LineEditor& in, std::ostream& out, std::ostream& err);

}  // namespace vitreo
