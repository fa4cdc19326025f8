// Scheduler of everything a script waits for: script tasks are coroutines, and only here the clock
// is asked to wait.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/time/clock.h"
#include "host/lua/interpreter/wait.h"

#include <lua.hpp>

#include <cstddef>
#include <exception>
#include <map>
#include <memory>
#include <string>
#include <vector>

namespace vitreo::lua {

struct Context;

/// One coroutine of the script, by way of run:together or as the root.
struct LuaTask {
  std::size_t number = 0;  // in the order in which they were made
  lua_State* thread = nullptr;
  int reference = LUA_NOREF;  // keeps the coroutine
  LuaTask* parent = nullptr;
  std::unique_ptr<Wait> wait;
  enum class State { ready, waiting, done } state = State::ready;
  int arguments = 0;         // for the first resume
  bool in_time = false;      // how the wait ended
  bool stop = false;         // the wait ends with a stop
  std::exception_ptr error;  // what the wait's predicate threw
  std::size_t stops = 0;     // stops that this task has felt
  int status = LUA_OK;
  int results = 0;  // on the thread's stack, or the error object
};

class Scheduler {
 public:
  explicit Scheduler(Context& context) : context_(context) {}
  ~Scheduler();
  Scheduler(const Scheduler&) = delete;
  Scheduler& operator=(const Scheduler&) = delete;

  /// Takes a function and `arguments` from the top of the main state, runs it to its end as a task,
  /// and leaves its results there; returns their number. Throws ScriptError, DeviceError, Stopped.
  int run(int arguments);

  /// The task that runs now, or null.
  LuaTask* current() const { return current_; }
  /// Makes a task of the function and arguments on top of L; a child of the current one.
  LuaTask& add(lua_State* L, int arguments);
  void remove(LuaTask& task);
  /// Its wait, and every later one until it has felt it, ends with a stop.
  void stop(LuaTask& task);
  bool all_done(const std::vector<LuaTask*>& tasks) const;

 private:
  void loop(const LuaTask& root);
  LuaTask* ready_task() { return ready_.empty() ? nullptr : ready_.begin()->second; }
  void make_ready(LuaTask& task);
  void resume(LuaTask& task);
  void wait_for_any();
  bool look_at_all();
  void look(LuaTask& task);
  void wait_on(const std::vector<Signal*>& signals, Time deadline);
  void end_waits(const std::exception_ptr& error);

  Context& context_;
  LuaTask* current_ = nullptr;
  // By number; of those that are ready the first one goes on.
  std::map<std::size_t, std::unique_ptr<LuaTask>> tasks_;
  std::map<std::size_t, LuaTask*> ready_;
  std::size_t made_ = 0;
  Signal any_;  // a watcher saw what it waited for
  unsigned long alarms_seen_ = 0;
};

}  // namespace vitreo::lua
