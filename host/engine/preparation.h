// Preparation of a run: findings of the preflight reported, refused or overridden.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/engine/rehearsal.h"
#include "host/session/session.h"

#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace vitreo {

/// A run that was refused because its preflight failed.
class PreflightError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Findings before the run, for its record, so that they outlive the terminal's window.
struct Preparation {
  std::vector<std::pair<std::string, std::string>> events;    // kind, text
  std::vector<std::pair<std::string, std::string>> concerns;  // name, text: alarms of low priority
  void record(Session& session) const;
};

/// What the dry run found, where there was one. Throws PreflightError when it failed and is not
/// overridden.
Preparation prepare(const RunRequest& request, const std::optional<PreflightReport>& rehearsed,
                    ProgressListener& listener);

/// Calibrations that are too old, and those of other instruments than `devices`, those that are
/// there: role: identity.
/// Nothing is energized yet. Throws as prepare() does where the rig says that they are refused.
void check_calibrations(const RunRequest& request, const RigDescription& description,
                        const nlohmann::json& devices, Preparation& preparation);

}  // namespace vitreo
