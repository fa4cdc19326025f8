// SPDX-License-Identifier: Apache-2.0
#include "host/engine/run_engine.h"

#include "devices/time/error.h"
#include "host/config/rights.h"
#include "host/engine/disk_need.h"
#include "host/engine/installed_calibration.h"
#include "host/engine/interrupts.h"
#include "host/engine/preflight.h"
#include "host/engine/preparation.h"
#include "host/files/log.h"
#include "host/rig/identities.h"
#include "host/rig/registry.h"
#include "host/servo/observers.h"
#include "host/session/faults.h"
#include "host/text/terminal_text.h"
#include "host/view/control_socket.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <iostream>
#include <optional>
#include <thread>
#include <unistd.h>

namespace vitreo {
namespace {

namespace fs = std::filesystem;

std::vector<FramePolicy> frame_policies(const RunRequest& request, const Rig& rig) {
  std::vector<FramePolicy> policies;
  for (const std::string& word : request.frames) {
    policies.push_back(parse_frame_policy(word));
    const std::string& camera = policies.back().camera;
    if ((camera == "top_camera" && rig.top_camera) || (camera == "side_camera" && rig.side_camera))
      continue;
    throw ConfigError("frames: " + word + ": this rig has no camera of that role");
  }
  return policies;
}

nlohmann::json to_json(const std::map<std::string, ArgumentValue>& arguments) {
  nlohmann::json object = nlohmann::json::object();
  for (const auto& [name, value] : arguments)
    std::visit([&object, &key = name](const auto& held) { object[key] = held; }, value);
  return object;
}

/// What a body's exception means for the run.
struct Verdict {
  Outcome outcome = Outcome::completed;
  ExitCode exit_code = ExitCode::completed;
  std::string reason;
};

Verdict judge(const std::function<void()>& body, const RunControl& control) {
  try {
    body();
    return {};
  } catch (const Stopped&) {
    if (control.tier() >= StopTier::abort) {
      const std::string how =
          control.tier() == StopTier::emergency ? "emergency stop " : "aborted ";
      return {Outcome::aborted, ExitCode::aborted, how + control.reason()};
    }
    return {Outcome::stopped, ExitCode::stopped, "stopped " + control.reason()};
  } catch (const DeviceError& error) {
    return {Outcome::aborted, ExitCode::aborted, error.what()};
  } catch (const ScriptError& error) {
    return {Outcome::failed, ExitCode::script_error, error.what()};
  } catch (const std::exception& error) {
    return {Outcome::failed, ExitCode::internal, error.what()};
  }
}

/// Everything that one run owns, in the order of birth; it dies the other way round, and the coils
/// with it.
struct RunStage {
  Rights rights;
  Pace pace = Pace::as_fast_as_possible;
  std::unique_ptr<Clock> clock;
  std::unique_ptr<OpenRig> rig;
  std::shared_ptr<DiskFaults> disk =
      std::make_shared<DiskFaults>();  // shared with the recorder's thread
  std::unique_ptr<Recorder> recorder;
};

RunStage build_stage(const RunRequest& request, const RigDescription& description) {
  RunStage stage;
  stage.rights = Rights::of(description);
  stage.pace = has_real_instruments(description) ? Pace::real_time : request.pace;
  stage.clock = has_real_instruments(description) ? wall_clock() : virtual_clock(stage.pace);
  stage.rig = open_rig(description, *stage.clock, request.seed, request.shifts);
  return stage;
}

RunStart start_record(const RunRequest& request, const ProtocolDescription& protocol,
                      nlohmann::json parameters, const RigDescription& description, OpenRig& rig) {
  RunStart start;
  start.protocol_file = protocol.file;
  start.protocol_title = protocol.title;
  start.protocol_text = protocol.text;
  start.parameters = std::move(parameters);
  for (const Parameter& parameter : protocol.parameters)
    start.parameter_units[parameter.name] = parameter.unit;
  start.rig = {
      {"file", description.file}, {"text", description.text}, {"resolved", rig.resolved()}};
  for (const RigSource& base : description.bases)
    start.rig["bases"].push_back({{"file", base.file}, {"text", base.text}});
  start.versions = versions();
  start.seed = request.seed;
  start.operator_name = operator_of(request);
  start.devices = identities(rig.rig());
  start.files = hashes_of_files(start.rig);
  return start;
}

/// s, between the moments at which the truth is of use: those of what looks. 0 where nothing does.
double watch_period(const Rig& rig) {
  if (rig.top_camera != nullptr) return rig.top_camera->info().frame_period;
  return rig.pose_sensor != nullptr ? rig.pose_sensor->period() : 0;
}

/// Under the virtual clock the recorder takes what it is given; in real time it must not hold up a
/// camera.
RecordLimits record_limits(const RunRequest& request, const RigDescription& description,
                           const std::shared_ptr<DiskFaults>& disk) {
  RecordLimits limits;
  limits.disk.free_bytes = [disk](const fs::path& place) {
    std::this_thread::sleep_for(std::chrono::milliseconds(disk->stall_ms.exchange(0)));
    return disk->full ? 0 : free_bytes(place);
  };
  limits.drop_frames = request.pace == Pace::real_time || has_real_instruments(description);
  return limits;
}

/// The disk's trouble ends the run as a lost device would, whatever the script made of it.
void judge_record(const Recorder& recorder, Verdict& verdict) {
  const std::string trouble = recorder.trouble();
  if (!trouble.empty())
    verdict = {Outcome::aborted, ExitCode::aborted, "recording failed: " + trouble};
}

/// Before there is a folder: throws ConfigError.
void check_faults(const RunRequest& request, const OpenRig& rig) {
  for (const std::string& word : request.faults) {
    try {
      check(parse_fault(word), simulated_roles(rig.resolved()));
    } catch (const std::invalid_argument& problem) {
      throw ConfigError("fault " + word + ": " + problem.what());
    }
  }
}

/// The last words of a run whose script never came back: the record is closed and the process left,
/// whatever hangs.
void give_up(RunStage& stage, const RunControl& control, double began) {
  const std::string reason =
      "not responding: the script was stuck" +
      (control.status().waiting_for.empty() ? "" : " in " + control.status().waiting_for) +
      "; the devices are safe";
  for (const std::string& failure : control.failures())
    stage.recorder->event(stage.clock->now(), "unsafe", failure);
  try {
    stage.recorder->finish(
        {Outcome::aborted, reason, to_seconds(stage.clock->now()), wall_seconds() - began});
  } catch (const std::exception& error) {
    std::cerr << "vitreo: " << error.what() << "\n";
  }
  std::cerr << "vitreo: " << reason << "; run: " << stage.recorder->folder().string() << std::endl;
  _exit(static_cast<int>(ExitCode::not_responding));
}

/// A run goes on without one where it cannot be had, and says so.
std::unique_ptr<ControlSocket> open_control(const RunRequest& request, Session& session,
                                            const fs::path& folder, const Rights& rights) {
  if (!request.control_socket) return nullptr;
  try {
    return std::make_unique<ControlSocket>(control_socket_path(folder.filename().string()),
                                           session.control, session.questions,
                                           ControlDesk{&session.alarms, rights});
  } catch (const std::exception& error) {
    session.recorder.event(session.clock.now(), "error",
                           std::string("no control socket: ") + error.what());
    return nullptr;
  }
}

/// The live view lets go of the session before it ends.
struct ScopeGuard {
  view::LiveView* view;
  const Verdict& verdict;
  ~ScopeGuard() {
    if (view != nullptr)
      view->end(std::string(to_string(verdict.outcome)) +
                (verdict.reason.empty() ? "" : ": " + verdict.reason));
  }
};

/// A stop that takes its time would look as if nobody had heard of it: the script's thread cannot
/// say anything.
std::function<void(const std::string&)> tell_of_ending() {
  return [first = true](const std::string& text) mutable {
    const bool terminal = isatty(STDERR_FILENO) != 0;
    std::cerr << (terminal && first ? "\n" : "") << "vitreo: " << text
              << (terminal && first ? " (Ctrl-C again: abort; once more: kill)" : "") << std::endl;
    first = false;
  };
}

void tell(const Session& session, const std::string& note) {
  session.recorder.event(session.clock.now(), "note", note);
  session.listener.message(note);
}

RunResult conduct(RunStage& stage, ScriptEngine& engine, const RunRequest& request,
                  ProgressListener& listener, const std::function<void(Session&)>& body,
                  const Inspect& inspect) {
  const double began = wall_seconds();
  Verdict verdict;
  std::string place;
  write_log("run " + stage.recorder->folder().string() + " begun by " +
            stage.recorder->start().operator_name);
  const std::vector<FramePolicy> policies = frame_policies(request, stage.rig->rig());
  std::unique_ptr<view::LiveView> live;
  if (request.view.on) live = std::make_unique<view::LiveView>(request.view, listener);
  {
    Session session(*stage.clock, stage.rig->rig(), *stage.recorder,
                    live ? live->listener() : listener, request.seed);
    const ScopeGuard farewell{live.get(), verdict};  // before the session ends
    session.real_time = stage.pace == Pace::real_time;
    session.questions.prepare(request.answers);
    session.control.attach({[&] {
                              engine.interrupt();
                              stage.clock->interrupt();
                            },
                            [&] { return stage.rig->make_safe(); }});
    const InterruptScope interrupts;
    if (live) {
      live->begin(session, stage.recorder->start().protocol_title, stage.rights);
      listener.message("live view: " + live->invitation());
    }
    const auto socket = open_control(request, session, stage.recorder->folder(), stage.rights);
    stage.recorder->on_trouble([&control = session.control] {
      control.request(StopTier::stop, "because recording failed");
    });
    FaultDesk faults({*stage.clock, *stage.rig->laboratory(), *stage.recorder, session.control,
                      *stage.disk, simulated_roles(stage.rig->resolved())});
    session.faults = &faults;
    for (const std::string& word : request.faults) faults.add(parse_fault(word));
    if (request.companion) request.companion(session);
    const double period = watch_period(session.rig);
    if (sim::Laboratory* laboratory = stage.rig->laboratory(); laboratory != nullptr && period > 0)
      session.keep(observe_truth(*stage.clock, *laboratory, period, *stage.recorder));
    {
      Interlock* const coils = session.rig.coils;
      if (coils != nullptr)
        coils->on_trip([&](const std::string& why) {
          stage.recorder->event(stage.clock->now(), "interlock", why);
          session.raise("interlock", AlarmPriority::high, why + "; the coils are at zero");
        });
      const Watchdog watchdog(
          session.control, *stage.clock, request.watchdog,
          {[&] { give_up(stage, session.control, began); },
           [coils] { return coils != nullptr && coils->energized(); },
           [coils](const std::string& why) { coils->trip(why); }, tell_of_ending()});
      const auto whole = [&] {
        const std::string disk =
            disk_warning(request.out, frame_bytes_per_second(policies, session.rig));
        if (!disk.empty()) session.raise("disk", AlarmPriority::medium, disk);
        for (const FramePolicy& policy : policies) session.frames.start(policy);
        body(session);
      };
      verdict = judge(whole, session.control);
    }
    if (session.rig.coils != nullptr) session.rig.coils->on_trip({});
    stage.recorder->on_trouble({});
    judge_record(*stage.recorder, verdict);
    session.control.detach();
    session.control.set_phase(RunPhase::ended);
    place = session.control.place();
    session.note_alarms();
    for (const std::string& failure : session.control.failures())
      stage.recorder->event(stage.clock->now(), "unsafe", failure);
    for (const std::string& failure : stage.rig->make_safe()) {
      stage.recorder->event(stage.clock->now(), "unsafe", failure);
      if (verdict.outcome == Outcome::completed)
        verdict = {Outcome::aborted, ExitCode::aborted, failure};
    }
  }
  const double experiment_time = to_seconds(stage.clock->now()), wall_time = wall_seconds() - began;
  stage.recorder->result({"experiment_time", experiment_time, "s"});
  stage.recorder->result({"wall_time", wall_time, "s"});
  try {
    stage.recorder->finish({verdict.outcome, verdict.reason, experiment_time, wall_time, place});
  } catch (const std::exception&
               error) {  // of the disk: the outputs are safe, and what could be saved was
    if (verdict.exit_code != ExitCode::aborted)
      verdict = {Outcome::aborted, ExitCode::aborted,
                 std::string("recording failed: ") + error.what()};
  }
  write_log("run " + stage.recorder->folder().string() + " " + to_string(verdict.outcome) +
            (verdict.reason.empty() ? "" : ": " + for_terminal(verdict.reason)));
  if (inspect) inspect(*stage.recorder, *stage.rig);
  return {verdict.outcome, verdict.exit_code, verdict.reason, stage.recorder->folder().string(),
          stage.recorder->results()};
}

}  // namespace

RunResult run_protocol(ScriptEngine& engine, const RunRequest& request, ProgressListener& listener,
                       const Inspect& inspect) {
  const CheckedRequest checked = check_request(engine, request);
  const auto& [protocol, arguments, description] = checked;
  Preparation preparation = prepare(engine, request, checked, listener);
  RunStage stage = build_stage(request, description);
  look_at_calibrations(request, description, *stage.rig, preparation);
  check_faults(request, *stage.rig);
  stage.recorder = std::make_unique<Recorder>(
      request.out, start_record(request, protocol, to_json(arguments), description, *stage.rig),
      record_limits(request, description, stage.disk));
  return conduct(
      stage, engine, request, listener,
      [&](Session& session) {
        preparation.tell(session);
        engine.run(protocol, arguments, session);
        for (const std::string& answer : session.questions.left_over())
          tell(session, "nothing was asked that wanted the answer " + answer);
      },
      inspect);
}

RunResult run_prompt(ScriptEngine& engine, const RunRequest& request, ProgressListener& listener,
                     LineEditor& in, std::ostream& out, std::ostream& err) {
  RigDescription description = engine.load_rig(request.rig_file);
  take_installed_calibration(description, request.out);
  Rights::of(description).require_researcher(operator_of(request), "the prompt");
  Preparation preparation;
  RunStage stage = build_stage(request, description);
  look_at_calibrations(request, description, *stage.rig, preparation);
  check_faults(request, *stage.rig);
  ProtocolDescription prompt;
  prompt.file = prompt.name = "prompt";
  prompt.title = "Prompt";
  stage.recorder = std::make_unique<Recorder>(
      request.out, start_record(request, prompt, nlohmann::json::object(), description, *stage.rig),
      record_limits(request, description, stage.disk));
  return conduct(
      stage, engine, request, listener,
      [&](Session& session) {
        preparation.tell(session);
        engine.prompt(session, in, out, err);
      },
      nullptr);
}

nlohmann::json to_json(const RunResult& result) {
  nlohmann::json results = nlohmann::json::object();
  for (const StatedResult& one : result.results) results[one.name] = one.value;
  nlohmann::json json = {
      {"outcome", to_string(result.outcome)}, {"run", result.folder}, {"results", results}};
  if (!result.reason.empty()) json["reason"] = result.reason;
  return json;
}

}  // namespace vitreo
