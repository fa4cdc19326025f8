// SPDX-License-Identifier: Apache-2.0
#include "host/engine/preparation.h"

#include "host/config/rights.h"
#include "host/files/log.h"
#include "host/record/record_json.h"
#include "host/rig/calibrations.h"

#include <fmt/format.h>

namespace vitreo {
namespace {

/// Throws PreflightError, unless a researcher overrides it; that is recorded, and logged outside of
/// the run.
/// The log outlives the run's folder: who overrode what can be looked up even where the run was
/// removed.
void refuse_or_override(const RunRequest& request, const RigDescription& rig,
                        const std::string& why, Preparation& preparation) {
  if (request.how.override_reason.empty()) throw PreflightError(why);
  const std::string name = operator_of(request);
  Rights::of(rig).require_researcher(name, "an override");
  preparation.events.emplace_back(
      "override", fmt::format("{} by {} ({})", why, name, request.how.override_reason));
  write_log("override by " + name + " (" + request.how.override_reason + "): " + why);
}

}  // namespace

void Preparation::record(Session& session) const {
  for (const auto& [kind, text] : events) session.recorder.event(session.clock.now(), kind, text);
  for (const auto& [name, text] : concerns) session.raise(name, AlarmPriority::low, text);
}

Preparation prepare(ScriptEngine& engine, const RunRequest& request, const CheckedRequest& checked,
                    ProgressListener& listener) {
  Preparation preparation;
  if (!request.how.override_reason.empty())
    // Refused before the dry run: it may take 10 s.
    Rights::of(checked.rig).require_researcher(operator_of(request), "an override");
  // A simulated rig can be hurt by nothing that the dry run would find.
  if (!is_laboratory(checked.rig)) return preparation;
  listener.message("preflight: a dry run on the rig's twin");
  const PreflightReport report = rehearse(engine, request, checked);
  preparation.events.emplace_back("preflight", dumped(to_json(report)));
  for (const std::string& warning : report.warnings) {
    listener.message("preflight: " + warning);
    preparation.concerns.emplace_back("preflight", warning);
  }
  if (!report.passed())
    refuse_or_override(request, checked.rig,
                       fmt::format("the preflight failed: {}", fmt::join(report.problems, "; ")),
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
    if (calibrations.refuse_stale) refuse_or_override(request, description, line, preparation);
    preparation.concerns.emplace_back("calibration", line);
  }
}

}  // namespace vitreo
