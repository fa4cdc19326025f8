// Bindings of run: its flow (waiting, progress, tasks side by side).
// SPDX-License-Identifier: Apache-2.0
#include "host/lua/interpreter/context.h"
#include "host/lua/interpreter/dead_time.h"
#include "host/lua/interpreter/errors.h"
#include "host/lua/interpreter/progress.h"
#include "host/lua/interpreter/scheduler.h"
#include "host/lua/interpreter/stop.h"
#include "host/lua/interpreter/turn.h"
#include "host/lua/interpreter/values.h"
#include "host/lua/rig/bind_rig.h"
#include "host/lua/run/classes.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace vitreo::lua {
namespace {

int wait(Call& call) {
  Wait wait;
  wait.deadline = later(session_of(call.L).clock.now(), from_seconds(call.number(0)));
  wait.finish = [](Call&, bool) { return 0; };
  return call.wait(std::move(wait));
}

int now(Call& call) { return call.result(to_seconds(session_of(call.L).clock.now()), "s"); }

int note(Call& call) {
  Session& session = session_of(call.L);
  session.recorder.event(session.clock.now(), "note", call.text(0));
  session.listener.message(call.text(0));
  return 0;
}

int progress(Call& call) {
  tell_progress(call.context(), call.number(0), call.has(1) ? call.text(1) : "");
  return 0;
}

/// The registry keeps the function; ScriptRun::clean_up() calls it and lets it go.
int defer(Call& call) {
  lua_pushvalue(call.L, call.index(0));
  call.context().deferred.push_back(luaL_ref(call.L, LUA_REGISTRYINDEX));
  return 0;
}

/// Takes the lap, and what was begun inside of it and left by break, from the stack.
void end_lap(Context& context, std::size_t id) {
  while (!context.laps.empty() && context.laps.back().id >= id) {
    tell_dead_time(context, context.laps.back());
    context.laps.pop_back();
  }
}

int close_lap(lua_State* L) {
  const HostCode host(context_of(L));
  end_lap(context_of(L), static_cast<std::size_t>(lua_tointeger(L, lua_upvalueindex(1))));
  return 0;
}

/// Laps inside of this one that are still open (an iterator that was called by hand is closed by no
/// loop) end with the next turn of the outer one.
void begin_turn(Context& context, std::size_t id, lua_Integer turn) {
  for (Lap& lap : context.laps) {
    if (lap.id != id) continue;
    end_lap(context, id + 1);
    lap.index = static_cast<std::size_t>(turn);
    context.fraction = 0;
    tell_progress(context, 0, fmt::format("{} {} of {}", lap.label, turn, lap.count));
    return;
  }
}

/// Upvalues: the list or nil, the count, the turn, the lap's id.
int next_turn(lua_State* L) {
  const lua_Integer count = lua_tointeger(L, lua_upvalueindex(2)),
                    turn = lua_tointeger(L, lua_upvalueindex(3)) + 1;
  const auto id = static_cast<std::size_t>(lua_tointeger(L, lua_upvalueindex(4)));
  Context& context = context_of(L);
  const HostCode host(context);
  if (turn > count) {
    tell_progress(context, 1, "");
    end_lap(context, id);
    return 0;
  }
  lua_pushinteger(L, turn);
  lua_replace(L, lua_upvalueindex(3));
  begin_turn(context, id, turn);
  if (lua_isnil(L, lua_upvalueindex(1)))
    lua_pushinteger(L, turn);
  else
    lua_rawgeti(L, lua_upvalueindex(1), turn);
  return 1;
}

/// Gives the generic for its iterator and, as fourth value, what closes the lap however the loop is
/// left.
int each(Call& call) {
  lua_State* const L = call.L;
  Context& context = call.context();
  const bool list = lua_istable(L, call.index(0));
  const double number = list ? 0 : call.number(0);
  if (!list && (lua_type(L, call.index(0)) != LUA_TNUMBER || number < 0 || number > 1e9 ||
                number != std::floor(number)))
    throw std::invalid_argument("list: wants a list or a whole number, got " +
                                pretty(L, call.index(0), 1));
  const lua_Integer count = list ? static_cast<lua_Integer>(lua_rawlen(L, call.index(0)))
                                 : static_cast<lua_Integer>(number);
  const std::size_t id = ++context.laps_begun;
  context.laps.push_back({id, 0, static_cast<std::size_t>(count),
                          call.has(1) ? call.text(1) : "turn", session_of(L).clock.now()});
  if (list)
    lua_pushvalue(L, call.index(0));
  else
    lua_pushnil(L);
  lua_pushinteger(L, count);
  lua_pushinteger(L, 0);
  lua_pushinteger(L, static_cast<lua_Integer>(id));
  lua_pushcclosure(L, next_turn, 4);
  lua_pushnil(L);
  lua_pushnil(L);
  lua_newtable(L);
  lua_createtable(L, 0, 1);
  lua_pushinteger(L, static_cast<lua_Integer>(id));
  lua_pushcclosure(L, close_lap, 1);
  lua_setfield(L, -2, "__close");
  lua_setmetatable(L, -2);
  return 4;
}

/// The first child that failed of itself decides; one that was stopped because of it does not.
LuaTask* failed_child(const std::vector<LuaTask*>& children) {
  LuaTask* stopped = nullptr;
  for (LuaTask* child : children) {
    if (child->state != LuaTask::State::done || child->status == LUA_OK) continue;
    if (!is_stop(child->thread, -1)) return child;
    stopped = child;
  }
  return stopped;
}

/// Every child is removed before an error is thrown on: a child that is left would run on without
/// its parent. A stop is thrown as a stop, which no pcall of the script may swallow.
int end_together(Call& call, const std::vector<LuaTask*>& children) {
  Scheduler& scheduler = *call.context().scheduler;
  bool stopped = false, failed = false;
  if (LuaTask* const child = failed_child(children)) {
    lua_xmove(child->thread, call.L, 1);
    stopped = is_stop(call.L, -1);
    failed = !stopped;
  }
  for (LuaTask* child : children) scheduler.remove(*child);
  if (stopped) throw Stopped();
  return failed ? lua_error(call.L) : 0;
}

/// Children are tasks of the scheduler. As soon as one fails the others are stopped, and the parent
/// waits until their clean-up has ended, too.
int together(Call& call) {
  call.check_can_wait();
  lua_State* const L = call.L;
  Scheduler& scheduler = *call.context().scheduler;
  for (int i = call.index(0); i <= lua_gettop(L); ++i)
    if (!lua_isfunction(L, i)) throw std::invalid_argument("wants functions, got " + kind_of(L, i));
  std::vector<LuaTask*> children;
  for (int i = call.index(0), last = lua_gettop(L); i <= last; ++i) {
    lua_pushvalue(L, i);
    children.push_back(&scheduler.add(L, 0));
  }
  Wait wait;
  wait.ends_children = true;
  wait.ready = [&scheduler, children, ending = false]() mutable {
    if (!ending && failed_child(children)) {
      ending = true;
      for (LuaTask* child : children) scheduler.stop(*child);
    }
    return scheduler.all_done(children);
  };
  wait.finish = [children](Call& done, bool) { return end_together(done, children); };
  return call.wait(std::move(wait));
}

}  // namespace

// From the innermost lap outwards: what is done of a turn is that part of 1/count of the lap around
// it, after the turns before.
void tell_progress(Context& context, double fraction, const std::string& label) {
  context.fraction = fraction;
  double whole = std::clamp(fraction, 0.0, 1.0);
  for (auto lap = context.laps.rbegin(); lap != context.laps.rend(); ++lap)
    if (lap->count > 0)
      whole = (std::max(1.0, static_cast<double>(lap->index)) - 1 + whole) /
              static_cast<double>(lap->count);
  if (!context.session) return;
  context.session->control.set_progress(whole, label);
  context.session->listener.progress(whole, label);
}

std::vector<Binding> run_flow_rows() {
  const auto text = [](const char* name, bool optional = false) {
    return Argument{.name = name, .type = Type::text, .optional = optional};
  };
  return {
      {"wait",
       {{.name = "duration", .type = Type::number, .unit = "s", .min = 0, .max = 1e6}},
       "",
       "waits",
       wait,
       "run:wait(0.1 * s)"},
      {"now", {}, {"number", "s"}, "the time since the run's clock was started", now, "run:now()"},
      {"each",
       {{.name = "list", .help = "a list, or a count"}, text("label", true)},
       "iterator",
       "walks a list, or counts from 1, and keeps the progress line",
       each,
       "run:each(3, \"repetition\")"},
      {"progress",
       {{.name = "fraction", .type = Type::number, .min = 0, .max = 1}, text("label", true)},
       "",
       "tells how far the run (inside run:each: this turn) is",
       progress,
       "run:progress(0.5, \"half of it\")"},
      {"note",
       {text("text")},
       "",
       "shows a line and keeps it in the record",
       note,
       "run:note(\"the gel is warm\")"},
      {"defer",
       {{.name = "clean_up", .type = Type::function}},
       "",
       "calls a function at the run's end, however it ends; the last deferred comes first",
       defer,
       "run:defer(function() print(\"the end\") end)"},
      {"together",
       {{.name = "..."}},
       "",
       "runs functions side by side until all have ended",
       together,
       "run:together(function() run:wait(1) end, function() run:wait(2) end)"}};
}

const Class& run_class() {
  static const Class kind = [] {
    Class made{"run", "this run: its flow, its record, its results", run_flow_rows(), {}};
    for (auto rows : {run_control_rows(), run_question_rows(), run_alarm_rows(),
                      run_operator_rows(), run_record_rows(), run_result_rows()})
      for (Binding& row : rows) made.methods.push_back(std::move(row));
    made.methods.push_back(install_calibration_row());
    return made;
  }();
  return kind;
}

void push_run(lua_State* L) {
  push_handle(L, run_class(), std::shared_ptr<void>(&context_of(L), [](void*) {}));
}

}  // namespace vitreo::lua
