// SPDX-License-Identifier: Apache-2.0
#include "host/engine/run_result.h"

#include "devices/time/clock.h"
#include "devices/time/error.h"
#include "host/session/run_facts.h"
#include "host/session/script_engine.h"

namespace vitreo {

std::string to_string(const Verdict& verdict) {
  return to_string(verdict.outcome) + (verdict.reason.empty() ? "" : ": " + verdict.reason);
}

Verdict judge(const std::function<void()>& body, const RunControl& control) {
  try {
    body();
    return {};
    // A requested end; its tier says whether clean-up came first.
  } catch (const Stopped&) {
    if (control.tier() < StopTier::abort)
      return {Outcome::stopped, ExitCode::stopped, "stopped " + control.reason(), control.cause()};
    const bool emergency = control.tier() == StopTier::emergency;
    return {Outcome::aborted, ExitCode::aborted,
            (emergency ? "emergency stop " : "aborted ") + control.reason(), control.cause()};
    // A lost device: the safe state was forced, so "aborted".
  } catch (const DeviceError& error) {
    // What lies beyond a limit is the script's mistake: no instrument failed, nothing was sent.
    if (error.kind == DeviceErrorKind::out_of_range)
      return {Outcome::failed, ExitCode::script_error, error.what()};
    return {Outcome::aborted, ExitCode::aborted, error.what(), {"device", error.device}};
    // Nothing that a script returned makes a trip undone.
  } catch (const UnacceptedFact& fact) {
    return {Outcome::aborted, ExitCode::aborted, fact.what(), {"interlock"}};
    // A fault of the protocol, not of the program.
  } catch (const ScriptError& error) {
    return {Outcome::failed, ExitCode::script_error, error.what()};
  } catch (const std::exception& error) {
    return {Outcome::failed, ExitCode::internal, error.what(), {"program"}};
  }
}

// A result that is NaN becomes null when this is printed: JSON has no NaN.
nlohmann::json to_json(const RunResult& result) {
  nlohmann::json results = nlohmann::json::object();
  for (const StatedResult& one : result.results) results[one.name] = one.value;
  nlohmann::json json = {{"outcome", to_string(result.outcome)},
                         {"exit_code", static_cast<int>(result.exit_code)},
                         {"run", result.folder},
                         {"results", results}};
  if (!result.reason.empty()) json["reason"] = result.reason;
  return json;
}

}  // namespace vitreo
