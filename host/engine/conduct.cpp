// SPDX-License-Identifier: Apache-2.0
#include "host/engine/conduct.h"

#include "host/engine/coil_report.h"
#include "host/engine/disk_need.h"
#include "host/engine/watchdog.h"
#include "host/files/log.h"
#include "host/files/run_folder.h"
#include "host/record/disk_alarm.h"
#include "host/servo/observers.h"
#include "host/text/error_words.h"
#include "host/text/terminal_text.h"

#include <fmt/format.h>

#include <chrono>
#include <iostream>
#include <unistd.h>

namespace vitreo {
namespace {

/// s between the moments at which the truth is of use: the period of the sensor of the loop. 0:
/// there is none.
/// A simulated run's truth is sampled at that rate, so that each measurement of the loop has a true
/// position of its own moment.
double truth_period(const Rig& rig) {
  if (rig.top_camera != nullptr) return rig.top_camera->info().frame_period;
  return rig.pose_sensor != nullptr ? rig.pose_sensor->period() : 0;
}

/// Scope guard of the faces that have begun: each ends, the last first, before the session dies.
class FaceScope {
 public:
  FaceScope() = default;
  ~FaceScope() {
    for (auto face = begun_.rbegin(); face != begun_.rend(); ++face) (*face)->end(outcome_);
  }
  FaceScope(const FaceScope&) = delete;
  FaceScope& operator=(const FaceScope&) = delete;
  void begin(Face& face, Session& session) {
    begun_.push_back(&face);
    face.begin(session);
  }
  void set_outcome(const std::string& outcome) { outcome_ = outcome; }

 private:
  std::vector<Face*> begun_;
  std::string outcome_ = "failed";
};

/// A fault of the recording stops the script, while it lives.
class RecordingGuard {
 public:
  RecordingGuard(Recorder& recorder, RunControl& control) : recorder_(recorder) {
    recorder_.on_fault([&recorder, &control] {
      control.request(StopTier::stop, "because recording failed: " + recorder.fault(),
                      {"recorder"});
    });
  }
  ~RecordingGuard() { recorder_.on_fault({}); }
  RecordingGuard(const RecordingGuard&) = delete;
  RecordingGuard& operator=(const RecordingGuard&) = delete;

 private:
  Recorder& recorder_;
};

/// Where the zero of a real run's clock lies, for data of others that are to be laid beside it. A
/// simulated run's times are no wall clock's.
void note_clock(const RunStage& stage) {
  if (stage.rig->laboratory() != nullptr) return;
  const Time now = stage.clock->now();
  const Time monotonic = std::chrono::steady_clock::now().time_since_epoch() - now;
  const std::chrono::system_clock::time_point zero(
      std::chrono::duration_cast<std::chrono::system_clock::duration>(
          Time(*stage.recorder->start().t0_utc_ns)));
  stage.recorder->event(now, "clock",
                        fmt::format("0 s is {}, and {:.6f} s of the monotonic clock",
                                    utc_text(zero), to_seconds(monotonic)));
}

/// What the rig's files leave in doubt, such as a bench that is drawn and counts as known: a
/// simulated run has no preflight that would say it.
void note_rig(const RunStage& stage) {
  for (const std::string& warning : stage.rig->rig().warnings)
    stage.recorder->event(stage.clock->now(), "rig", warning);
}

/// Act one: the session with all that is attached to it. It dies in reverse order, the faces before
/// the session.
class RunSession {
 public:
  // The order matters: rights and answers before any face can send a command, the hooks of control
  // before any face can end the run, faults last, for they need all the rest.
  RunSession(RunStage& stage, ScriptEngine& engine, const RunRequest& request,
             ProgressListener& listener)
      : stage_(stage),
        session_(*stage.clock, stage.rig->rig(), *stage.recorder, listener, request.how.seed),
        recording_(*stage.recorder, session_.control),
        faults_({*stage.clock, stage.rig->laboratory(), *stage.recorder, session_.control,
                 *stage.disk, stage.breakable}) {
    // A stop that comes in between is felt by the script, which knows how to end.
    const StopShield shield(*stage.clock);
    session_.real_time = stage.pace == Pace::real_time;
    session_.questions.prepare(request.what.answers);
    session_.desk.set_rights(stage.rights);
    // Before any face begins: what it requests must reach the script.
    session_.control.attach({[&engine, &stage] {
                               engine.interrupt();
                               stage.clock->interrupt();
                             },
                             [&stage] { return stage.rig->make_safe(); }});
    stage.rig->on_unguarded([this](const std::string& why) {
      session_.control.request(StopTier::abort, "because " + why);
    });
    stage.interrupts->begin(session_.control);
    // A face reports its own failure in the record and does not throw (host/session/face.h).
    for (Face* face : request.how.faces) faces_.begin(*face, session_);
    note_clock(stage);
    note_rig(stage);
    session_.faults = &faults_;
    for (const Fault& fault : stage.faults) faults_.add(fault);
    if (request.how.companion) request.how.companion(session_);
    if (session_.rig.coils != nullptr)
      if (auto warmth =
              observe_coil_temperatures(*stage.clock, *session_.rig.coils, *stage.recorder))
        session_.keep(std::move(warmth));
    const double period = truth_period(session_.rig);
    sim::Laboratory* const world = stage.rig->laboratory();
    if (world != nullptr) record_machine(*stage.recorder, stage.clock->now(), *world);
    if (world != nullptr && period > 0)
      session_.keep(observe_truth(*stage.clock, *world, period, *stage.recorder));
  }
  ~RunSession() { stage_.rig->on_unguarded({}); }
  RunSession(const RunSession&) = delete;
  RunSession& operator=(const RunSession&) = delete;

  Session& session() { return session_; }
  void set_outcome(const Verdict& verdict) { faces_.set_outcome(to_string(verdict)); }

 private:
  RunStage& stage_;
  Session session_;
  const RecordingGuard recording_;
  FaceScope faces_;
  // Its tasks use the session's control, so they end first.
  FaultInjector faults_;
};

/// End of a run whose script never came back: the record is closed and the process left, whatever
/// hangs. Called by the watchdog with the clock's baton; the devices are safe by then.
void give_up(RunStage& stage, const RunControl& control, double began) {
  const std::string waiting = control.status().waiting_for;
  const std::string reason = "not responding: the script was stuck" +
                             (waiting.empty() ? "" : " in " + waiting) + "; the devices are safe";
  for (const std::string& failure : control.failures())
    stage.recorder->event(stage.clock->now(), "unsafe", failure);
  try {
    stage.recorder->finish({Outcome::aborted,
                            reason,
                            to_seconds(stage.clock->now()),
                            wall_seconds() - began,
                            "",
                            {"watchdog"}});
  } catch (const std::exception& error) {
    std::cerr << "vitreo: " << error.what() << "\n";
  }
  std::cerr << "vitreo: " << reason << "; run: " << stage.recorder->folder().string() << std::endl;
  // Not exit(): static destructors would run beside the thread that hangs.
  _exit(static_cast<int>(ExitCode::not_responding));
}

/// Reports a stop that takes its time: the script's thread cannot say anything meanwhile.
std::function<void(const std::string&)> report_of_ending() {
  return [first = true](const std::string& text) mutable {
    // After the progress line, which has no end of line; and the hint once, for a person only.
    const bool terminal = isatty(STDERR_FILENO) != 0;
    std::cerr << (terminal && first ? "\n" : "") << "vitreo: " << text
              << (terminal && first ? " (Ctrl-C again: abort; once more: kill)" : "") << std::endl;
    first = false;
  };
}

/// Scope guard: interlock trips go into the record and raise an alarm.
class TripReport {
 public:
  TripReport(RunStage& stage, Session& session) : coils_(session.rig.coils) {
    if (coils_ == nullptr) return;
    coils_->on_trip([this, &stage, &session](const Interlock::Trip& trip) {
      stage.recorder->event(stage.clock->now(), "interlock", trip.why);
      // A claim of an alarm is true: an amplifier that did not take the zero is still energized.
      session.raise("interlock", AlarmPriority::high,
                    trip.why + (coils_->energized()
                                    ? "; the coils may be energized: the amplifier did not take "
                                      "the zero"
                                    : "; the coils are at zero"));
      // What a script may come back from is a trip of its own doing, not a broken instrument.
      if (trip.broken)
        session.control.request(StopTier::abort, "because " + trip.why, {"interlock"});
    });
    coils_->on_rest([&stage](const CoilRest& rest) { record_rest(stage, rest); });
  }
  ~TripReport() {
    if (coils_ == nullptr) return;
    coils_->on_trip({});
    coils_->on_rest({});
  }
  TripReport(const TripReport&) = delete;
  TripReport& operator=(const TripReport&) = delete;

 private:
  Interlock* const coils_;
};

/// Act two: the script under the watchdog, until it ends or is ended.
Verdict carry_out(RunStage& stage, RunSession& run, const RunRequest& request,
                  const std::function<void(Session&)>& body, double began) {
  Session& session = run.session();
  Interlock* const coils = session.rig.coils;
  // Destroyed in reverse: the watchdog first, so that it never acts on a run that has ended.
  const TripReport trips(stage, session);
  const Watchdog watchdog(
      session.control, *stage.clock, request.how.watchdog,
      {[&] { give_up(stage, session.control, began); },
       [coils] { return coils != nullptr && coils->energized(); },
       [coils](const std::string& why) { coils->trip(why); }, report_of_ending()});
  const auto script = [&] {
    // Part of what is judged: a camera that cannot be recorded is an outcome of the run.
    const std::string disk =
        disk_warning(request.where.out, frame_bytes_per_second(stage.frames, session.rig));
    if (!disk.empty()) session.raise(kDiskAlarm, AlarmPriority::medium, disk);
    for (const FramePolicy& policy : stage.frames) session.frames.start(policy);
    // Throws for every end that is not the script's own; judge() says what that means for the run.
    switch_light_on(session.rig);
    body(session);
  };
  return judge(script, session.control);
}

/// Again on every exit: the first may have failed, and clean-up may have energized something since.
/// An instrument whose cable was out is tried until it is back, for half a second; then the
/// guardian goes on. Returns what failed last.
std::vector<std::string> make_safe_in_time(RunStage& stage) {
  constexpr Time kPatience = std::chrono::milliseconds(500), kPause = std::chrono::milliseconds(50);
  const Time until = stage.clock->now() + kPatience;
  std::vector<std::string> failures = stage.rig->make_safe();
  // Each instrument opens its link anew, where that is what it takes.
  while (!failures.empty() && stage.clock->now() < until) {
    stage.clock->sleep_for(kPause);
    failures = stage.rig->make_safe();
  }
  return failures;
}

/// Everything to its safe state, each device on its own; what failed is an event, and no run of
/// that kind is completed. Returns the script's location at its end.
std::string make_safe(RunStage& stage, Session& session, Verdict& verdict) {
  // Not even a stop cuts this short: what is energized goes to zero first.
  const StopShield shield(*stage.clock);
  // From here on a fault of the disk is read here, not signalled to the script.
  const std::string fault = stage.recorder->fault();
  // A failed disk ends a run as a lost device would.
  if (!fault.empty())
    verdict = {Outcome::aborted, ExitCode::aborted, "recording failed: " + fault, {"recorder"}};
  stage.interrupts->end();
  session.control.detach();
  session.control.set_phase(RunPhase::ended);
  session.note_alarms();
  // Failures of the safe state that an abort or the watchdog has brought about already.
  for (const std::string& failure : session.control.failures())
    stage.recorder->event(stage.clock->now(), "unsafe", failure);
  for (const std::string& failure : make_safe_in_time(stage)) {
    stage.recorder->event(stage.clock->now(), "unsafe", failure);
    if (verdict.outcome == Outcome::completed)
      verdict = {Outcome::aborted,
                 ExitCode::aborted,
                 "came to its end, but could not be made safe: " + failure,
                 {"device"}};
  }
  // Whatever was sent: the record says what is.
  if (session.rig.coils != nullptr) record_rest(stage, session.rig.coils->read_rest());
  return session.control.location();
}

/// Act three: the end record, then the report.
/// The record is closed after the outputs are safe: what the record says about them is then a fact.
/// The wall clock's result is left out of the canonical export, so runs still compare to the bit.
void close_record(RunStage& stage, Verdict& verdict, const std::string& location, double began) {
  // The two times are results like any other, so that runs can be compared by them.
  const double experiment_time = to_seconds(stage.clock->now());
  const double wall_time = wall_seconds() - began;
  stage.traced.end();
  stage.recorder->result({"experiment_time", experiment_time, "s"});
  stage.recorder->result({"wall_time", wall_time, "s"});
  try {
    stage.recorder->finish(
        {verdict.outcome, verdict.reason, experiment_time, wall_time, location, verdict.cause});
  } catch (const std::exception& error) {
    // Of the disk: the outputs are safe, and what could be saved was.
    if (verdict.exit_code != ExitCode::aborted)
      verdict = {Outcome::aborted,
                 ExitCode::aborted,
                 std::string("recording failed: ") + error.what(),
                 {"recorder"}};
  }
}

}  // namespace

// An exception that reaches the handler below is the engine's own, such as a camera that cannot be
// decorated: the rig is made safe there too, since make_safe() above may not have been reached.
RunResult conduct(RunStage& stage, ScriptEngine& engine, const RunRequest& request,
                  ProgressListener& listener, const std::function<void(Session&)>& body,
                  const Inspect& inspect) {
  const double began = wall_seconds();
  const std::string folder = stage.recorder->folder().string();
  write_log("run " + folder + " begun by " + stage.recorder->start().operator_name);
  Verdict verdict;
  std::string location;
  try {
    // The three acts; an exception of a script never comes out of the second.
    RunSession run(stage, engine, request, listener);
    verdict = carry_out(stage, run, request, body, began);
    location = make_safe(stage, run.session(), verdict);
    run.set_outcome(verdict);
  } catch (const std::exception& error) {  // of the engine itself; the record says so
    for (const std::string& failure : stage.rig->make_safe())
      stage.recorder->event(stage.clock->now(), "unsafe", failure);
    verdict = {Outcome::failed, ExitCode::internal, error_words(error), {"program"}};
  }
  stage.interrupts->end();
  close_record(stage, verdict, location, began);
  write_log("run " + folder + " " + for_terminal(to_string(verdict)));
  if (inspect) inspect(*stage.recorder, *stage.rig);
  return {verdict.outcome, verdict.exit_code, verdict.reason, folder, stage.recorder->results()};
}

}  // namespace vitreo
