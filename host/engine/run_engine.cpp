// SPDX-License-Identifier: Apache-2.0
#include "host/engine/run_engine.h"

#include "host/config/rights.h"
#include "host/engine/preparation.h"
#include "host/engine/request_check.h"

namespace vitreo {
namespace {

void note(const Session& session, const std::string& text) {
  session.recorder.event(session.clock.now(), "note", text);
  session.listener.message(text);
}

}  // namespace

RunResult run_protocol(ScriptEngine& engine, const RunRequest& request, ProgressListener& listener,
                       const Inspect& inspect) {
  // Check, rehearse, prepare, open, conduct; up to open_record() nothing is written.
  const CheckedRequest checked = check_request(engine, request);
  // Refused before the dry run: it may take 10 s.
  if (!request.how.override_reason.empty())
    Rights::of(checked.rig).require_researcher(operator_of(request), "an override");
  const std::optional<PreflightReport> rehearsed =
      rehearse_on_twin(engine, request, checked, listener);
  Preparation preparation = prepare(request, rehearsed, listener);
  RunStage stage = open_stage(request, checked, listener);
  check_calibrations(request, checked.rig, stage.devices, preparation);
  open_record(stage, request, checked);
  const auto script = [&](Session& session) {
    preparation.record(session);
    engine.run(checked.protocol, checked.arguments, session);
    // A misspelt --answer would otherwise go unnoticed.
    for (const std::string& answer : session.questions.unused_answers())
      note(session, "nothing was asked that wanted the answer " + answer);
    // What happened decides, whatever the script has made of it.
    if (session.control.stop_felt()) throw Stopped();
    session.facts.check();
  };
  return conduct(stage, engine, request, listener, script, inspect);
}

// The same straight line; there is no script to rehearse.
RunResult run_prompt(ScriptEngine& engine, const RunRequest& request, ProgressListener& listener,
                     LineEditor& in, std::ostream& out, std::ostream& err) {
  const CheckedRequest checked = check_prompt(engine, request);
  // A prompt has no declared parameters with limits, so it is not for technicians.
  Rights::of(checked.rig).require_researcher(operator_of(request), "the prompt");
  Preparation preparation;
  RunStage stage = open_stage(request, checked, listener);
  check_calibrations(request, checked.rig, stage.devices, preparation);
  open_record(stage, request, checked);
  const auto statements = [&](Session& session) {
    preparation.record(session);
    engine.prompt(session, in, out, err);
  };
  return conduct(stage, engine, request, listener, statements, nullptr);
}

}  // namespace vitreo
