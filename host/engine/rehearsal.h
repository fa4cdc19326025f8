// Rehearsal: a dry run of the script on the rig's simulated twin, before anything is energized.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/engine/preflight_report.h"
#include "host/engine/request_check.h"

#include <functional>
#include <optional>

namespace vitreo {

struct PreflightLimits {
  double wall = 10;  // s, then it is "not fully simulated"
  /// What to do when the script sits in a call that nothing can interrupt, so that the dry run
  /// cannot be left; must not return. The default says so on the standard error and ends the
  /// process with ExitCode::preflight_failed: nothing was opened.
  std::function<void(const PreflightReport&)> stuck;
};

/// The dry run, on the virtual clock, in a folder of its own that goes. Throws only what is no
/// fault of the script's; Stopped when the operator stopped it.
PreflightReport rehearse(ScriptEngine& engine, const RunRequest& request,
                         const CheckedRequest& checked, const PreflightLimits& limits = {});

/// The same before a run: on a laboratory rig only, for a simulated one can be hurt by nothing that
/// the dry run would find.
std::optional<PreflightReport> rehearse_on_twin(ScriptEngine& engine, const RunRequest& request,
                                                const CheckedRequest& checked,
                                                ProgressListener& listener);

/// The check and the rehearsal, for `vitreo check`; what check_request throws goes on.
PreflightReport preflight(ScriptEngine& engine, const RunRequest& request,
                          const PreflightLimits& limits = {});

}  // namespace vitreo
