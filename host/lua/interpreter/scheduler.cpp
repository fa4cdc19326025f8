// SPDX-License-Identifier: Apache-2.0
#include "host/lua/interpreter/scheduler.h"

#include "devices/time/error.h"
#include "host/lua/interpreter/context.h"
#include "host/lua/interpreter/dead_time.h"
#include "host/lua/interpreter/errors.h"
#include "host/lua/interpreter/stop.h"
#include "host/lua/interpreter/turn.h"

#include <algorithm>
#include <stdexcept>
#include <utility>

namespace vitreo::lua {
namespace {

/// The end of a task's body: an error goes on, its <close> variables are closed (and could wait
/// while they were).
int end_body(lua_State* L, int status, lua_KContext) {
  if (status != LUA_OK && status != LUA_YIELD) return lua_error(L);
  return lua_gettop(L) - 1;
}

int task_body(lua_State* L) {
  lua_pushcfunction(L, remember_trace);
  lua_insert(L, 1);
  return end_body(L, lua_pcallk(L, lua_gettop(L) - 2, LUA_MULTRET, 1, 0, end_body), 0);
}

}  // namespace

Scheduler::~Scheduler() {
  for (const auto& [number, task] : tasks_)
    luaL_unref(context_.main, LUA_REGISTRYINDEX, task->reference);
}

LuaTask& Scheduler::add(lua_State* L, int arguments) {
  auto task = std::make_unique<LuaTask>();
  task->number = made_++;
  task->thread = lua_newthread(L);
  task->reference = luaL_ref(L, LUA_REGISTRYINDEX);
  task->parent = current_;
  task->arguments = arguments + 1;
  luaL_checkstack(task->thread, arguments + 2, "too many arguments");
  lua_pushcfunction(task->thread, task_body);
  lua_xmove(L, task->thread, arguments + 1);
  LuaTask& added = *(tasks_[task->number] = std::move(task));
  make_ready(added);
  return added;
}

void Scheduler::make_ready(LuaTask& task) {
  task.state = LuaTask::State::ready;
  ready_[task.number] = &task;
}

void Scheduler::remove(LuaTask& task) {
  luaL_unref(context_.main, LUA_REGISTRYINDEX, task.reference);
  ready_.erase(task.number);
  tasks_.erase(task.number);
}

int Scheduler::run(int arguments) {
  lua_State* const L = context_.main;
  LuaTask* root = nullptr;
  in_lua(L, arguments + 1, [&] { root = &add(L, arguments); });
  loop(*root);
  const int results = root->results, status = root->status;
  lua_checkstack(L, results + 4);
  lua_xmove(root->thread, L, results);
  remove(*root);
  if (status != LUA_OK) std::rethrow_exception(to_exception(L, status));
  return results;
}

void Scheduler::loop(const LuaTask& root) {
  while (root.state != LuaTask::State::done) {
    if (LuaTask* const task = ready_task())
      resume(*task);
    else
      wait_for_any();
  }
}

void Scheduler::resume(LuaTask& task) {
  current_ = &task;
  context_.running = task.thread;
  context_.stops_felt = &task.stops;
  if (context_.interrupted) arm_stop(task.thread);
  int results = 0;
  const int status = [&] {
    const PlainLua plain(context_);
    return lua_resume(task.thread, context_.main, std::exchange(task.arguments, 0), &results);
  }();
  ready_.erase(task.number);  // only now: it may have stopped itself
  context_.running = nullptr;
  context_.stops_felt = nullptr;
  current_ = nullptr;
  if (status == LUA_YIELD) {
    lua_pop(task.thread, results);
    task.state = LuaTask::State::waiting;
    return;
  }
  task.state = LuaTask::State::done;
  task.status = status;
  task.results = status == LUA_OK ? results : 1;
}

void Scheduler::look(LuaTask& task) {
  if (task.state != LuaTask::State::waiting) return;
  try {
    const Wait& wait = *task.wait;
    task.in_time = wait.ready && wait.ready();
    const Time now = context_.session->clock.now();
    if (!task.in_time && now >= context_.waits_end && !wait.ends_children)
      task.stop = true;
    else if (!task.in_time && now < wait.deadline)
      return;
  } catch (const std::exception&) {
    task.error = std::current_exception();
  }
  make_ready(task);
}

bool Scheduler::look_at_all() {
  // A predicate may stop its children, which never adds or removes a task.
  for (const auto& [number, task] : tasks_) look(*task);
  return ready_task() != nullptr;
}

void Scheduler::wait_for_any() {
  if (look_at_all()) return;
  std::vector<Signal*> signals;
  Time deadline = kForever;
  std::string what, idle, useful;
  for (const auto& [number, task] : tasks_) {
    if (task->state != LuaTask::State::waiting) continue;
    if (!task->wait->ends_children) {
      what += (what.empty() ? "" : ", ") + task->wait->what;
      (is_dead_time(task->wait->what) ? idle : useful) =
          task->wait->what;  // side by side, what is useful counts
      deadline = std::min(deadline, context_.waits_end);
    }
    deadline = std::min(deadline, task->wait->deadline);
    Signal* const signal = task->wait->signal;
    if (signal && std::find(signals.begin(), signals.end(), signal) == signals.end())
      signals.push_back(signal);
  }
  context_.session->control.set_waiting_for(what);
  const Time began = context_.session->clock.now();
  try {
    wait_on(signals, deadline);
  } catch (const Stopped&) {
    take_interrupt(context_);
    end_waits(nullptr);
  } catch (const std::exception&) {  // the clock's: nobody could ever go on
    end_waits(std::current_exception());
  }
  context_.session->control.set_waiting_for("");
  if (!context_.laps.empty())
    add_wait(context_, useful.empty() ? idle : useful, context_.session->clock.now() - began);
  if (context_.session->alarms.changes() != alarms_seen_) {
    context_.session->note_alarms();
    alarms_seen_ = context_.session->alarms.changes();
  }
}

/// A clock waits for one signal; where there are several, each gets a task that watches it.
void Scheduler::wait_on(const std::vector<Signal*>& signals, Time deadline) {
  Clock& clock = context_.session->clock;
  const auto look = [this] { return look_at_all(); };
  if (signals.empty()) {
    clock.sleep_until(deadline);
    return;
  }
  if (signals.size() == 1) {
    clock.wait(*signals[0], look, deadline);
    return;
  }
  std::vector<std::unique_ptr<Task>> watchers;
  watchers.reserve(signals.size());
  for (Signal* const signal : signals)
    watchers.push_back(clock.spawn("script: watch", [this, &clock, signal, look] {
      clock.wait(*signal, look, kForever);
      clock.notify(any_);
    }));
  clock.wait(
      any_, [this] { return ready_task() != nullptr; }, deadline);
}

void Scheduler::end_waits(const std::exception_ptr& error) {
  for (const auto& [number, task] : tasks_) {
    if (task->state != LuaTask::State::waiting || task->wait->ends_children) continue;
    task->stop = !error;
    task->error = error;
    make_ready(*task);
  }
}

void Scheduler::stop(LuaTask& task) {
  if (task.state == LuaTask::State::done) return;
  if (task.state == LuaTask::State::waiting && task.wait->ends_children) {
    for (const auto& [number, child] : tasks_)
      if (child->parent == &task) stop(*child);
    return;
  }
  task.stop = true;
  make_ready(task);
}

bool Scheduler::all_done(const std::vector<LuaTask*>& tasks) const {
  return std::all_of(tasks.begin(), tasks.end(),
                     [](const LuaTask* task) { return task->state == LuaTask::State::done; });
}

}  // namespace vitreo::lua
