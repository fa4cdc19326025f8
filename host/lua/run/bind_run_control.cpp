// Bindings of run: pausing, suspending and ending.
// SPDX-License-Identifier: Apache-2.0
#include "host/lua/interpreter/binding.h"
#include "host/lua/interpreter/context.h"
#include "host/lua/interpreter/errors.h"
#include "host/lua/interpreter/people.h"
#include "host/lua/interpreter/scheduler.h"
#include "host/lua/interpreter/values.h"
#include "host/lua/run/classes.h"

#include <algorithm>
#include <stdexcept>

namespace vitreo::lua {
namespace {

constexpr Time kLook =
    std::chrono::milliseconds(50);         // of the clock, between two looks at a condition
constexpr double kPauseLimit = 12 * 3600;  // s of wall time

/// A condition of the script's own that holds the run up at its checkpoints.
std::string holding_condition(Call& call) {
  lua_State* const L = call.L;
  for (const Context::Suspender& suspender : call.context().suspenders) {
    lua_rawgeti(L, LUA_REGISTRYINDEX, suspender.condition);
    lua_call(L, 0, 1);
    const bool holds = lua_toboolean(L, -1);
    lua_pop(L, 1);
    if (holds) return suspender.reason;
  }
  return "";
}

const Context::Suspender* suspender_of(const Context& context, const std::string& reason) {
  const auto found = std::find_if(context.suspenders.begin(), context.suspenders.end(),
                                  [&](const Context::Suspender& s) { return s.reason == reason; });
  return found == context.suspenders.end() ? nullptr : &*found;
}

/// The coils first: what follows may command them. `kind` is the event: resumed by people, or by
/// the end of a condition.
int go_on(Call& call, const std::string& kind) {
  Session& session = session_of(call.L);
  if (session.rig.coils != nullptr) session.rig.coils->resume();
  session.control.resume();
  session.control.set_phase(RunPhase::running);
  session.recorder.event(session.clock.now(), kind, "");
  session.alarms.clear("suspended");
  session.note_alarms();
  return 0;
}

/// A dry run has nobody who would let it go on.
int rehearse_pause(const Session& session, const std::string& why) {
  session.rehearsal->remarks.push_back("the run would wait for its operator: " + why);
  return 0;
}

/// The phase is set before the message, so that who reads it finds the run paused; the coils go to
/// what the rig says for a pause.
int pause_here(Call& call, const std::string& name) {
  Session& session = session_of(call.L);
  if (session.rehearsal != nullptr) {
    session.control.resume();
    return rehearse_pause(session, "paused at the checkpoint '" + name + "'");
  }
  session.control.set_phase(RunPhase::paused, name);
  session.recorder.event(session.clock.now(), "paused", name);
  session.listener.message("paused at the checkpoint '" + name +
                           "' (go on: vitreo control resume)");
  if (session.rig.coils != nullptr) session.rig.coils->pause(session.rig.coil_pause);
  return call.wait(wait_for_people(
      call, "resume", [&session] { return session.control.resumed(); },
      [](Call& done) { return go_on(done, "resumed"); }, kPauseLimit));
}

int look_again(Call& call, const std::string& reason);

/// The clock goes on: what holds the run up may end of itself, as a coil cools.
Wait suspended_wait(const Call& call, const std::string& reason) {
  Wait wait;
  wait.what = "'" + reason + "' to end";
  wait.deadline = later(session_of(call.L).clock.now(), kLook);
  wait.finish = [reason](Call& done, bool) { return look_again(done, reason); };
  return wait;
}

/// Any condition holds the run up, not only the one that began it; the time-out is that one's.
int look_again(Call& call, const std::string& reason) {
  const std::string holds = holding_condition(call);
  if (holds.empty()) return go_on(call, "condition ended");
  const auto* suspender = suspender_of(call.context(), reason);
  const Session& session = session_of(call.L);
  if (suspender && session.clock.now() >= suspender->give_up_at)
    throw std::runtime_error("suspended for longer than allowed: " + reason);
  return call.wait(suspended_wait(call, reason));
}

/// Before people are told of it: who hears of it may answer at once.
void begin_mending(Session& session, const std::string& reason) {
  session.control.request_pause();
  session.control.set_phase(RunPhase::suspended, reason + "; resume when it is mended");
}

int wait_for_mending(Call& call, const std::string& reason);

/// The operator says that it is mended. While the condition still holds, only a researcher's
/// override goes on.
int resume_suspended(Call& call, const std::string& reason) {
  Session& session = session_of(call.L);
  const std::string by = session.control.take_override(), holds = holding_condition(call);
  if (!by.empty())
    session.recorder.event(session.clock.now(), "override", "suspended: " + holds + "; by " + by);
  if (holds.empty() || !by.empty()) return go_on(call, "resumed");
  begin_mending(session, reason);
  session.listener.message("still suspended: " + holds +
                           "; mend it, or override it (a researcher's right)");
  return wait_for_mending(call, reason);
}

int wait_for_mending(Call& call, const std::string& reason) {
  Session& session = session_of(call.L);
  return call.wait(wait_for_people(
      call, "resume", [&session] { return session.control.resumed(); },
      [reason](Call& done) { return resume_suspended(done, reason); }, kPauseLimit));
}

/// Whether a condition's suspender lets the run go on by itself; from now on its time runs.
bool begin_timeouts(Context& context, const std::string& reason, Time now) {
  bool resumes = false;
  for (Context::Suspender& suspender : context.suspenders) {
    if (suspender.reason != reason) continue;
    suspender.give_up_at = later(now, from_seconds(suspender.timeout));
    resumes = resumes || suspender.resumes;
  }
  return resumes;
}

/// Two ways on: by itself, when the condition has ended and its suspender says `resume`; else
/// people must say that it is mended. A dry run takes neither, and remarks it.
int suspend_here(Call& call, const std::string& reason) {
  Session& session = session_of(call.L);
  session.recorder.event(session.clock.now(), "suspended", reason);
  if (session.rig.coils != nullptr) session.rig.coils->pause(session.rig.coil_pause);
  const bool resumes = begin_timeouts(call.context(), reason, session.clock.now());
  const bool mended_by_people = !resumes && session.rehearsal == nullptr;
  if (resumes) session.control.set_phase(RunPhase::suspended, reason);
  if (mended_by_people) begin_mending(session, reason);
  session.listener.message("suspended: " + reason);
  if (resumes) return call.wait(suspended_wait(call, reason));
  if (!mended_by_people) return rehearse_pause(session, reason);
  session.raise("suspended", AlarmPriority::medium, reason);
  return wait_for_mending(call, reason);
}

/// The place at which a pause takes effect, and where a condition holds the run up.
int checkpoint(Call& call) {
  Session& session = session_of(call.L);
  const std::string name = call.text(0);
  session.recorder.event(session.clock.now(), "checkpoint", name);
  call.check_can_wait();
  if (session.control.pause_wanted_at(name)) return pause_here(call, name);
  if (const std::string reason = holding_condition(call); !reason.empty())
    return suspend_here(call, reason);
  Wait wait;
  wait.deadline = session.clock.now();
  wait.finish = [](Call&, bool) { return 0; };
  return call.wait(std::move(wait));
}

int suspend_when(Call& call) {
  lua_pushvalue(call.L, call.index(1));
  Context::Suspender suspender;
  suspender.reason = call.text(0);
  suspender.condition = luaL_ref(call.L, LUA_REGISTRYINDEX);
  suspender.resumes = call.flag_option("resume");
  suspender.timeout = call.number_option("timeout").value_or(600);
  call.context().suspenders.push_back(suspender);
  return 0;
}

int pause(Call& call) {
  session_of(call.L).desk.perform(
      {.word = "pause", .source = "the script", .text = call.has(0) ? call.text(0) : ""});
  return 0;
}

/// Stopped is thrown here already, so that no statement after the call runs.
int end(Call& call, StopTier tier) {
  Session& session = session_of(call.L);
  const std::string reason = call.has(0) ? call.text(0) : "";
  session.recorder.event(session.clock.now(), to_string(tier),
                         "asked by the script" + (reason.empty() ? "" : ": " + reason));
  session.desk.perform({.word = to_string(tier), .source = "the script", .text = reason});
  throw Stopped();
}
int stop(Call& call) { return end(call, StopTier::stop); }
int abort(Call& call) { return end(call, StopTier::abort); }

/// The script's thread holds the baton, and so it is the one that notes events.
int accept(Call& call) {
  Session& session = session_of(call.L);
  session.facts.accept(session.clock.now(), call.text(0), call.text(1));
  return 0;
}

Argument reason_argument() { return {.name = "reason", .type = Type::text, .optional = true}; }

}  // namespace

std::vector<Binding> run_control_rows() {
  return {
      {"checkpoint",
       {{.name = "name", .type = Type::text}},
       "",
       "a place where a pause takes effect, and where a condition of suspend_when holds the run up",
       checkpoint,
       "run:checkpoint(\"before the path\")"},
      {"pause",
       {{.name = "checkpoint", .type = Type::text, .optional = true}},
       "",
       "asks for a pause at the next checkpoint, or at the one of that name",
       pause},
      {"suspend_when",
       {{.name = "reason", .type = Type::text},
        {.name = "condition",
         .type = Type::function,
         .help = "true while the run is to be held up; must not wait"},
        {.name = "options",
         .type = Type::options,
         .optional = true,
         .options = {{.name = "resume",
                      .type = Type::flag,
                      .optional = true,
                      .help = "goes on by itself when it has ended"},
                     {.name = "timeout",
                      .type = Type::number,
                      .unit = "s",
                      .optional = true,
                      .min = 0,
                      .help = "then it is an error (default: 600 s)"}}}},
       "",
       "holds the run up at its checkpoints while a condition is true",
       suspend_when,
       "run:suspend_when(\"too warm\", function() return false end)"},
      {"accept",
       {{.name = "fact",
         .type = Type::text,
         .help = "interlock: it tripped; servo failed: a loop ended by an error",
         .choices = RunFacts::kinds()},
        {.name = "reason", .type = Type::text, .help = "for the record"}},
       "",
       "says that what happened is part of this run; else a run in which it did ends aborted, "
       "whatever the script returns",
       accept,
       "run:defer(function() pcall(run.accept, run, \"interlock\", \"the limit is what is tried\") "
       "end)"},
      {"stop",
       {reason_argument()},
       "",
       "ends the run: its clean-up, then the devices' safe state",
       stop},
      {"abort",
       {reason_argument()},
       "",
       "ends the run: the devices' safe state first, then a short clean-up",
       abort}};
}

}  // namespace vitreo::lua
