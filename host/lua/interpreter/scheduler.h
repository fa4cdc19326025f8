// Scheduler of everything a script waits for: script tasks are coroutines, and only here the clock
// is asked to wait.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/time/clock.h"
#include "host/lua/interpreter/binding.h"

#include <lua.hpp>

#include <functional>
#include <memory>
#include <string>
#include <vector>

namespace vitreo::lua {

/// What a host call waits for. After it the call goes on in `finish`, which pushes the results and
/// returns their number; `in_time` is what `ready` said last. Without `ready` only the deadline
/// ends the wait.
struct Wait {
  Signal* signal = nullptr;     // null: nothing but time
  std::function<bool()> ready;  // looked at after each notification; it may throw
  Time deadline = kForever;
  std::function<int(Call&, bool in_time)> finish;
  bool ends_children = false;  // run:together: a stop goes to the children, not to this wait
  std::string what{};          // as the status shows it; Call::wait fills in the call's name
};

/// What an error says of a wait that took too long, beside operation, time and the script's line.
struct WaitInfo {
  std::string target{};  // "1.5 mm"; empty: none
  std::function<std::string()>
      reading{};  // where it is now; called on the job's task, may throw. Null: none
};

/// "wanted 1.5 mm; last reading 0.2 mm; after 60 s"; `reading` may be empty.
std::string waited_text(const std::string& target, const std::string& reading, double elapsed);

/// A wait for a blocking call that runs as a task of the clock, for the device `name`. Past
/// `timeout` it is stopped and std::runtime_error thrown; the device's own DeviceError{timeout}
/// goes on with what `about` knows added.
Wait work(const Call& call, const std::string& name, std::function<void()> blocking, Time timeout,
          std::function<int(Call&)> finish, WaitInfo about = {});

/// One coroutine of the script, by way of run:together or as the root.
struct LuaTask {
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

  /// From `until` on every wait ends with a stop: the budget of a clean-up. A later time than
  /// before changes nothing.
  void limit_waits(Time until);
  void unlimit_waits() { limit_ = kForever; }

 private:
  void loop(const LuaTask& root);
  LuaTask* ready_task();
  void resume(LuaTask& task);
  void wait_for_any();
  bool look_at_all();
  void look(LuaTask& task);
  void wait_on(const std::vector<Signal*>& signals, Time deadline);
  void end_waits(const std::exception_ptr& error);

  Context& context_;
  LuaTask* current_ = nullptr;
  std::vector<std::unique_ptr<LuaTask>> tasks_;
  Signal any_;  // a watcher saw what it waited for
  Time limit_ = kForever;
  unsigned long alarms_seen_ = 0;
};

/// WaitInfo-for calls go on here after the task was resumed.
int continue_wait(lua_State* L, int status, lua_KContext binding);

}  // namespace vitreo::lua
