// Context of one Lua state: the session it serves, its scheduler, what it must close.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/record/recorder.h"
#include "host/session/session.h"

#include <lua.hpp>

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace vitreo::lua {

class Scheduler;
struct Binding;
struct Library;
struct StageMotions;

/// One run:each that is being walked.
struct Lap {
  std::size_t id = 0, index = 0, count = 0;  // index from 1
  std::string label;
  Time began{};
  std::map<std::string, double>
      waited{};  // s, by what was waited for: see host/lua/interpreter/dead_time.h
};

/// In Lua's registry: {name = true} of the results that a protocol at the prompt has stated; nil
/// before the first one.
constexpr const char* kStatedResults = "vitreo.stated_results";

/// Reachable from every coroutine by context_of(). Never outlives its Session.
struct Context {
  lua_State* main = nullptr;
  const Library* library = nullptr;
  Session* session = nullptr;  // null while a file is only read
  Scheduler* scheduler = nullptr;
  std::size_t* stops_felt = nullptr;  // by the task that runs now; null between tasks
  Time waits_end = kForever;          // every later wait ends with a stop: a clean-up's budget
  std::vector<std::string> folders;   // of require
  std::uint64_t seed = 0;
  std::function<void(const std::string&)> print;  // of print() and help()

  std::atomic<lua_State*> running{
      nullptr};  // the coroutine that Lua executes now; read by a signal handler
  std::atomic<bool> interrupted{false};  // a stop that no script has felt yet
  static_assert(std::atomic<bool>::is_always_lock_free &&
                std::atomic<lua_State*>::is_always_lock_free);

  std::size_t memory = 0, memory_limit = 0;  // bytes
  bool short_of_memory = false;              // an allocation was refused
  std::string trace, where;                  // of the last error: the trace, and "file:line: "
  std::string stopped_at;                    // "file:line: " at which the first stop was felt

  // Of a file that is only being read (arm_reading_limit).
  std::int64_t reading_left = 0;  // instructions
  double reading_ends = 0;        // s of the thread's own time

  std::vector<std::shared_ptr<const void>> kept;  // what the state's classes are made of
  std::vector<std::function<void()>> closers;     // end what the script left open; in reverse order
  std::vector<int> deferred;                      // references of run:defer's functions
  std::vector<Lap> laps;
  std::size_t laps_begun = 0;
  std::map<const Camera*, std::uint64_t> last_frames;  // that the script was given
  double fraction = 0;                                 // as last told
  double dead_time = 0;                                // s, of the outermost run:each
  struct Script {
    int stream = 0;
    std::vector<std::string> channels;
  };
  std::map<std::string, Script> script_streams;  // of run:record
  /// Of each stage, by its address, that the script has set off (host/lua/rig/motion.h).
  std::map<const void*, std::shared_ptr<StageMotions>> motions;
  struct Suspender {
    std::string reason;
    int condition = 0;  // reference of its function
    bool resumes = false;
    double timeout = 0;  // s
    Time give_up_at{};
  };
  std::vector<Suspender> suspenders;

  // At the prompt only.
  std::vector<std::string> protocol_folders;  // of run("name")
  bool remembers_results = false;
  struct Result {
    const Binding* call = nullptr;
    double number = 0;              // the first value, where it is a number
    const void* pointer = nullptr;  // or a table
  };
  Result last_result;
  struct Nested {  // a protocol that runs inside of a statement: what it defers and opens ends with
                   // it
    std::size_t deferred = 0, closers = 0;
    std::map<std::string, std::string> files;  // that it wrote, by its own names for them
  };
  std::optional<Nested> nested;
};

Context& context_of(lua_State* L);
/// "file:line: " of the innermost function that is written in Lua, or "".
std::string where(lua_State* L);
/// The session, or an error that says that a file is only being read.
Session& session_of(lua_State* L);

}  // namespace vitreo::lua
