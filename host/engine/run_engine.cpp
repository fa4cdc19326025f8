// SPDX-License-Identifier: Apache-2.0
#include "host/engine/run_engine.h"

#include "host/config/rights.h"
#include "host/engine/installed_calibration.h"
#include "host/engine/preparation.h"
#include "host/engine/request_check.h"

namespace vitreo {
namespace {

/// Values in SI, as the record keeps them.
nlohmann::json to_json(const std::map<std::string, ArgumentValue>& arguments) {
  nlohmann::json object = nlohmann::json::object();
  for (const auto& [name, value] : arguments)
    std::visit([&object, &key = name](const auto& held) { object[key] = held; }, value);
  return object;
}

void note(const Session& session, const std::string& text) {
  session.recorder.event(session.clock.now(), "note", text);
  session.listener.message(text);
}

}  // namespace

RunResult run_protocol(ScriptEngine& engine, const RunRequest& request, ProgressListener& listener,
                       const Inspect& inspect) {
  // Check, rehearse, prepare, open, conduct; up to open_record() nothing is written.
  const CheckedRequest checked = check_request(engine, request);
  Preparation preparation = prepare(engine, request, checked, listener);
  RunStage stage = open_stage(request, checked.rig, listener);
  check_calibrations(request, checked.rig, *stage.rig, preparation);
  open_record(stage, request, checked.protocol, to_json(checked.arguments), checked.rig);
  const auto script = [&](Session& session) {
    preparation.record(session);
    engine.run(checked.protocol, checked.arguments, session);
    // A misspelt --answer would otherwise go unnoticed.
    for (const std::string& answer : session.questions.unused_answers())
      note(session, "nothing was asked that wanted the answer " + answer);
  };
  return conduct(stage, engine, request, listener, script, inspect);
}

// The same straight line without a protocol: what run_protocol() takes from its description, a
// prompt has empty.
RunResult run_prompt(ScriptEngine& engine, const RunRequest& request, ProgressListener& listener,
                     LineEditor& in, std::ostream& out, std::ostream& err) {
  RigDescription rig = engine.load_rig(request.where.rig_file);
  take_installed_calibration(rig, request.where.out);
  // A prompt has no declared parameters with limits, so it is not for technicians; nor is there a
  // script to rehearse.
  Rights::of(rig).require_researcher(operator_of(request), "the prompt");
  RunStage stage = open_stage(request, rig, listener);
  Preparation preparation;
  check_calibrations(request, rig, *stage.rig, preparation);
  ProtocolDescription prompt;
  prompt.file = prompt.name = "prompt";
  prompt.title = "Prompt";
  open_record(stage, request, prompt, nlohmann::json::object(), rig);
  const auto statements = [&](Session& session) {
    preparation.record(session);
    engine.prompt(session, in, out, err);
  };
  return conduct(stage, engine, request, listener, statements, nullptr);
}

}  // namespace vitreo
