// State of a running script: with a scheduler and all handles, and its orderly end.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/lua/interpreter/scheduler.h"
#include "host/lua/interpreter/state.h"
#include "host/session/script_engine.h"

#include <atomic>
#include <map>
#include <string>
#include <vector>

namespace vitreo::lua {

/// What a signal handler may look at while a script runs.
struct Running {
  std::atomic<Context*> context{nullptr};
  std::atomic<unsigned long> thread{0};  // pthread_t of who runs it
};

class ScriptRun {
 public:
  ScriptRun(const Library& library, Running& running, Session& session,
            const std::vector<std::string>& folders);
  ~ScriptRun();
  ScriptRun(const ScriptRun&) = delete;
  ScriptRun& operator=(const ScriptRun&) = delete;
  lua_State* main() const { return state_.main(); }
  Scheduler& scheduler() { return scheduler_; }
  Context& context() { return state_.context(); }
  /// The deferred functions, the last first, then what the script left open. Each on its own: the
  /// first error is thrown when all are done. What was there before may be kept: the first so many
  /// of each.
  void clean_up(std::size_t keep_deferred = 0, std::size_t keep_closers = 0);

 private:
  Running& running_;
  State state_;
  Scheduler scheduler_;  // dies first: its waits may hold tasks
};

void run_protocol(ScriptRun& script, const ProtocolDescription& protocol,
                  const std::map<std::string, ArgumentValue>& arguments);
/// The table p: a parameter that was not declared is an error, not nil.
void push_parameters(lua_State* L, const ProtocolDescription& protocol,
                     const std::map<std::string, ArgumentValue>& arguments);
}  // namespace vitreo::lua
