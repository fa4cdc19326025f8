// run: pausing, suspending, ending, and questions to the operator.
// SPDX-License-Identifier: Apache-2.0
#include "host/config.h"
#include "host/lua/binding.h"
#include "host/lua/context.h"
#include "host/lua/errors.h"
#include "host/lua/scheduler.h"
#include "host/lua/values.h"
#include "host/units.h"

#include <algorithm>
#include <stdexcept>
#include <thread>

namespace vitreo::lua {
namespace {

constexpr std::chrono::milliseconds kLookOutside{10};  // of wall time, for what people do while the clock stands
constexpr Time kLook = std::chrono::milliseconds(50);  // of the clock, where it goes on

/// Waits for people. In real time the clock goes on, and the loop with it; otherwise it stands still, so that the
/// answer comes at the same time in every run of the same seed.
Wait outside_wait(const Call& call, const std::string& what, const std::function<bool()>& ready,
                  const std::function<int(Call&)>& then) {
  Session& session = session_of(call.L);
  Wait wait;
  wait.what = what;
  session.control.set_waiting_for(what);
  if (!session.real_time)
    while (!ready() && session.control.tier() == StopTier::none) std::this_thread::sleep_for(kLookOutside);
  // Not yet answered: the clock's wait is what a stop breaks off.
  wait.deadline = ready() ? session.clock.now() : later(session.clock.now(), kLook);
  wait.finish = [=](Call& done, bool) {
    return ready() ? then(done) : done.wait(outside_wait(done, what, ready, then));
  };
  return wait;
}

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

int go_on(Call& call, const std::string& kind) {
  Session& session = session_of(call.L);
  if (session.rig.coils != nullptr) session.rig.coils->resume();
  session.control.resume();
  session.control.set_phase(RunPhase::running);
  session.recorder.event(session.clock.now(), kind, "");
  return 0;
}

int pause_here(Call& call, const std::string& name) {
  Session& session = session_of(call.L);
  session.control.set_phase(RunPhase::paused, name);
  session.recorder.event(session.clock.now(), "paused", name);
  session.listener.message("paused at the checkpoint '" + name + "'");
  if (session.rig.coils != nullptr) session.rig.coils->pause(session.rig.coil_pause);
  return call.wait(outside_wait(
      call, "resume", [&session] { return session.control.resumed(); },
      [](Call& done) { return go_on(done, "resumed"); }));
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

int look_again(Call& call, const std::string& reason) {
  const std::string holds = holding_condition(call);
  if (holds.empty()) return go_on(call, "condition ended");
  const auto* suspender = suspender_of(call.context(), reason);
  const Session& session = session_of(call.L);
  if (suspender && session.clock.now() >= suspender->give_up_at)
    throw std::runtime_error("suspended for longer than allowed: " + reason);
  return call.wait(suspended_wait(call, reason));
}

int suspend_here(Call& call, const std::string& reason) {
  Session& session = session_of(call.L);
  session.recorder.event(session.clock.now(), "suspended", reason);
  if (session.rig.coils != nullptr) session.rig.coils->pause(session.rig.coil_pause);
  session.listener.message("suspended: " + reason);
  for (Context::Suspender& suspender : call.context().suspenders) {
    if (suspender.reason != reason) continue;
    suspender.give_up_at = later(session.clock.now(), from_seconds(suspender.timeout));
    if (suspender.resumes) {
      session.control.set_phase(RunPhase::suspended, reason);
      return call.wait(suspended_wait(call, reason));
    }
  }
  session.control.request_pause();
  session.control.set_phase(RunPhase::suspended, reason + "; resume when it is mended");
  return call.wait(outside_wait(
      call, "resume", [&session] { return session.control.resumed(); },
      [](Call& done) { return go_on(done, "resumed"); }));
}

/// The place at which a pause takes effect, and where a condition holds the run up.
int checkpoint(Call& call) {
  Session& session = session_of(call.L);
  const std::string name = call.text(0);
  session.recorder.event(session.clock.now(), "checkpoint", name);
  call.check_can_wait();
  if (session.control.pause_wanted_at(name)) return pause_here(call, name);
  if (const std::string reason = holding_condition(call); !reason.empty()) return suspend_here(call, reason);
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
  session_of(call.L).control.request_pause(call.has(0) ? call.text(0) : "");
  return 0;
}

int end(Call& call, StopTier tier) {
  Session& session = session_of(call.L);
  const std::string reason = call.has(0) ? call.text(0) : "";
  session.recorder.event(session.clock.now(), to_string(tier),
                         "asked by the script" + (reason.empty() ? "" : ": " + reason));
  session.control.set_reason("by the script" + (reason.empty() ? "" : ": " + reason));
  session.control.request(tier);
  throw Stopped();
}
int stop(Call& call) { return end(call, StopTier::stop); }
int abort(Call& call) { return end(call, StopTier::abort); }

int push_answer(Call& call, const Parameter& parameter, const ArgumentValue& value) {
  if (const bool* flag = std::get_if<bool>(&value)) {
    lua_pushboolean(call.L, *flag);
    return 1;
  }
  if (const double* number = std::get_if<double>(&value)) {
    if (parameter.kind != ParameterKind::integer) return call.result(*number);
    lua_pushinteger(call.L, static_cast<lua_Integer>(*number));
    return 1;
  }
  return call.result(std::get<std::string>(value));
}

/// What the operator typed, if anything: an answer that does not do is said why, and the question stays open.
bool answered(Session& session) {
  if (const auto line = session.listener.typed()) {
    try {
      session.questions.answer(*line, "operator at the terminal");
    } catch (const ConfigError& problem) {
      session.listener.message(problem.what());
    }
  }
  return session.questions.answered();
}

int put_question(Call& call, Question question) {
  Session& session = session_of(call.L);
  call.check_can_wait();
  session.recorder.event(session.clock.now(), "question", shown(question));
  session.questions.ask(question);
  session.listener.question(question);
  return call.wait(outside_wait(
      call, "an answer to '" + question.text + "'", [&session] { return answered(session); },
      [&session, parameter = question.answer](Call& done) {
        const auto answer = session.questions.take();
        session.recorder.event(session.clock.now(), "answer", answer->text + " (" + answer->by + ")");
        return push_answer(done, parameter, answer->value);
      }));
}

std::string question_name(const Call& call) { return call.text_option("name").value_or("answer"); }

int confirm(Call& call) {
  Question question;
  question.text = call.text(0);
  question.answer.name = question_name(call);
  question.answer.kind = ParameterKind::flag;
  question.answer.fallback = false;
  return put_question(call, std::move(question));
}

std::vector<std::string> choices_of(const Call& call) {
  std::vector<std::string> choices;
  if (call.push_option("choices")) {
    const auto count = static_cast<lua_Integer>(lua_rawlen(call.L, -1));
    for (lua_Integer i = 1; i <= count; ++i) {
      lua_rawgeti(call.L, -1, i);
      choices.push_back(plain_text(call.L, -1));
      lua_pop(call.L, 1);
    }
    if (choices.empty()) throw std::invalid_argument("choices: the list is empty");
  }
  lua_pop(call.L, 1);
  return choices;
}

ParameterKind kind_of_question(const Call& call, bool has_choices) {
  const std::string type = call.text_option("type").value_or(has_choices ? "choice" : "number");
  const std::pair<const char*, ParameterKind> kinds[] = {{"number", ParameterKind::number},
                                                         {"integer", ParameterKind::integer},
                                                         {"choice", ParameterKind::choice},
                                                         {"text", ParameterKind::text}};
  for (const auto& [name, kind] : kinds)
    if (type == name) return kind;
  throw std::invalid_argument("type: wants number, integer, choice or text, got " + type);
}

int ask(Call& call) {
  Question question;
  question.text = call.text(0);
  Parameter& answer = question.answer;
  answer.name = question_name(call);
  answer.choices = choices_of(call);
  answer.kind = kind_of_question(call, !answer.choices.empty());
  if (answer.kind == ParameterKind::choice && answer.choices.empty())
    throw std::invalid_argument("choices: wants the list to choose from");
  answer.unit = call.text_option("unit").value_or("");
  if (!find_unit(answer.unit) && !answer.unit.empty())
    throw std::invalid_argument("unit: " + answer.unit + " is not a unit");
  answer.min = call.number_option("min").value_or(answer.min);
  answer.max = call.number_option("max").value_or(answer.max);
  const bool number = answer.kind == ParameterKind::number || answer.kind == ParameterKind::integer;
  question.has_default = call.push_option("default");
  if (number)
    answer.fallback = question.has_default ? lua_tonumber(call.L, -1) : std::clamp(1.0, answer.min, answer.max);
  else
    answer.fallback = question.has_default ? plain_text(call.L, -1) : std::string();
  lua_pop(call.L, 1);
  return put_question(call, std::move(question));
}

/// Dies, and ends, with its handle or with the run.
struct Reminder {
  std::unique_ptr<Task> task;
};

int remind(Call& call) {
  Session& session = session_of(call.L);
  const Time every = from_seconds(call.number_option("every").value_or(300));
  auto reminder = std::make_shared<Reminder>();
  reminder->task = session.clock.spawn("reminder", [&session, every, text = call.text(0)] {
    while (true) {
      session.clock.sleep_for(every);
      session.recorder.event(session.clock.now(), "reminder", text);
      session.listener.message("reminder: " + text);
    }
  });
  call.context().closers.emplace_back([held = std::weak_ptr<Reminder>(reminder)] {
    if (const auto alive = held.lock()) alive->task.reset();
  });
  push_handle(call.L, reminder_class(), std::move(reminder));
  return 1;
}

int close_reminder(Call& call) {
  if (call.self_pointer()) call.self<Reminder>().task.reset();
  close_handle(call);
  return 0;
}

Argument reason_argument() { return {.name = "reason", .type = Type::text, .optional = true}; }

}  // namespace

std::vector<Binding> run_control_rows() {
  const Argument name{.name = "name", .type = Type::text, .optional = true, .help = "for an answer given in advance"};
  return {
      {"checkpoint",
       {{.name = "name", .type = Type::text}},
       "",
       "a place where a pause takes effect, and where a condition of suspend_when holds the run up",
       checkpoint},
      {"pause",
       {{.name = "checkpoint", .type = Type::text, .optional = true}},
       "",
       "asks for a pause at the next checkpoint, or at the one of that name",
       pause},
      {"suspend_when",
       {{.name = "reason", .type = Type::text},
        {.name = "condition", .type = Type::function, .help = "true while the run is to be held up; must not wait"},
        {.name = "options",
         .type = Type::options,
         .optional = true,
         .options =
             {{.name = "resume", .type = Type::flag, .optional = true, .help = "goes on by itself when it has ended"},
              {.name = "timeout",
               .type = Type::number,
               .unit = "s",
               .optional = true,
               .min = 0,
               .help = "then it is an error (default: 600 s)"}}}},
       "",
       "holds the run up at its checkpoints while a condition is true",
       suspend_when},
      {"stop", {reason_argument()}, "", "ends the run: its clean-up, then the devices' safe state", stop},
      {"abort", {reason_argument()}, "", "ends the run: the devices' safe state first, then a short clean-up", abort},
      {"confirm",
       {{.name = "text", .type = Type::text},
        {.name = "options", .type = Type::options, .optional = true, .options = {name}}},
       "true or false",
       "asks the operator a question of yes or no",
       confirm},
      {"ask",
       {{.name = "text", .type = Type::text},
        {.name = "options",
         .type = Type::options,
         .optional = true,
         .options = {name,
                     {.name = "type", .type = Type::text, .optional = true, .help = "number, integer, choice or text"},
                     {.name = "unit", .type = Type::text, .optional = true},
                     {.name = "min", .type = Type::number, .optional = true},
                     {.name = "max", .type = Type::number, .optional = true},
                     {.name = "choices", .type = Type::list, .optional = true},
                     {.name = "default", .type = Type::any, .optional = true}}}},
       "the answer; numbers in SI",
       "asks the operator for a value",
       ask},
      {"remind",
       {{.name = "text", .type = Type::text},
        {.name = "options",
         .type = Type::options,
         .optional = true,
         .options = {{.name = "every", .type = Type::number, .unit = "s", .optional = true, .min = 1, .max = 1e5}}}},
       "reminder",
       "reminds the operator again and again (default: every 5 minutes) until it is closed or the run ends",
       remind}};
}

const Class& reminder_class() {
  static const Class kind{
      "reminder", "a reminder that comes back", {{"close", {}, "", "ends it", close_reminder, true}}, {}};
  return kind;
}

}  // namespace vitreo::lua
