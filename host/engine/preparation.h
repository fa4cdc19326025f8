// What is done with a preflight's findings before a run begins: told, refused, or overridden.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/engine/preflight.h"
#include "host/session/session.h"

#include <string>
#include <utility>
#include <vector>

namespace vitreo {

/// Who is responsible: as asked for, else whose account it is.
std::string operator_of(const RunRequest& request);

/// What was found before the run, for its record: nothing of it is lost with the terminal's window.
struct Preparation {
  std::vector<std::pair<std::string, std::string>> events;    // kind, text
  std::vector<std::pair<std::string, std::string>> concerns;  // name, text: alarms of low priority
  void tell(Session& session) const;
};

/// On a laboratory rig the dry run, before anything is opened; on a simulated one it would only
/// show what follows. Throws PreflightError when it fails and is not overridden, RightError when
/// that is asked for by a technician.
Preparation prepare(ScriptEngine& engine, const RunRequest& request, const CheckedRequest& checked,
                    ProgressListener& listener);

/// Calibrations that are too old, and those of other instruments than the ones that are there.
/// Nothing is energized yet. Throws as prepare() does where the rig says that they are refused.
void look_at_calibrations(const RunRequest& request, const RigDescription& description,
                          OpenRig& rig, Preparation& preparation);

}  // namespace vitreo
