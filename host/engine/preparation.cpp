// SPDX-License-Identifier: Apache-2.0
#include "host/engine/preparation.h"

#include "host/files/log.h"
#include "host/record/record_json.h"
#include "host/rig/calibrations.h"

#include <fmt/format.h>

namespace vitreo {
namespace {

/// Throws PreflightError, unless it is overridden, which run_protocol() leaves to researchers;
/// that is recorded, and logged outside of the run. The log outlives the run's folder: who overrode
/// what can be looked up even where the run was removed.
void refuse_or_override(const RunRequest& request, const std::string& why,
                        Preparation& preparation) {
  if (request.how.override_reason.empty()) throw PreflightError(why);
  const std::string name = operator_of(request);
  preparation.events.emplace_back(
      "override", fmt::format("{} by {} ({})", why, name, request.how.override_reason));
  write_log("override by " + name + " (" + request.how.override_reason + "): " + why);
}

}  // namespace

void Preparation::record(Session& session) const {
  for (const auto& [kind, text] : events) session.recorder.event(session.clock.now(), kind, text);
  for (const auto& [name, text] : concerns) session.raise(name, AlarmPriority::low, text);
}

Preparation prepare(const RunRequest& request, const std::optional<PreflightReport>& rehearsed,
                    ProgressListener& listener) {
  Preparation preparation;
  if (!rehearsed) return preparation;
  preparation.events.emplace_back("preflight", dumped(to_json(*rehearsed)));
  for (const std::string& warning : rehearsed->warnings) {
    listener.message("preflight: " + warning);
    preparation.concerns.emplace_back("preflight", warning);
  }
  if (!rehearsed->passed())
    refuse_or_override(
        request, fmt::format("the preflight failed: {}", fmt::join(rehearsed->problems, "; ")),
        preparation);
  return preparation;
}

void check_calibrations(const RunRequest& request, const RigDescription& description,
                        const nlohmann::json& devices, Preparation& preparation) {
  const Calibrations calibrations = Calibrations::of(description);
  // Here the instruments are open, so their identities can be compared; the dry run only knows
  // dates.
  std::vector<std::string> lines = calibrations.out_of_date(today_text());
  for (std::string& line : calibrations.of_others(devices)) lines.push_back(std::move(line));
  for (const std::string& line : lines) {
    if (calibrations.refuse_stale) refuse_or_override(request, line, preparation);
    preparation.concerns.emplace_back("calibration", line);
  }
}

}  // namespace vitreo
