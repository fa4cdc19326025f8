// Sandbox of a driver that is written in Lua: a state of its own with bounded memory and bounded
// work in each call. It reaches nothing by itself; what it wants of the world are operations, which
// the host carries out while the script waits.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/time/clock.h"

#include <lua.hpp>

#include <cstddef>
#include <cstdint>
#include <exception>
#include <memory>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <variant>

namespace vitreo::scripted {

struct SandboxLimits {
  std::size_t memory = 16u << 20;       ///< bytes, all that the script holds
  std::int64_t instructions = 1000000;  ///< of Lua's machine, between two operations
};

/// What is wrong with a driver's own text, with file and line: "pump.lua:12: attempt to index a nil
/// value".
class ScriptFault : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// What the script's operations do.
class Operations {
 public:
  virtual ~Operations() = default;
  /// The arguments are all that is on L; pushes the results, and returns how many. Throws
  /// DeviceError (the script may catch it), std::invalid_argument for wrong arguments, Stopped.
  virtual int perform(std::string_view operation, lua_State* L) = 0;
};

/// A function or table of the script. Lives no longer than its sandbox.
class Reference {
 public:
  Reference() = default;
  /// Takes the value on top of L's stack, and pops it.
  explicit Reference(lua_State* L);
  void push() const;
  explicit operator bool() const { return held_ != nullptr; }

 private:
  struct Held;
  std::shared_ptr<Held> held_;
};

/// A message, or a function of the file; neither: it is not there.
using Action = std::variant<std::monostate, std::string, Reference>;
inline bool is_there(const Action& action) { return action.index() != 0; }

class Sandbox {
 public:
  /// `file`: how errors call it.
  explicit Sandbox(const std::string& file, const SandboxLimits& limits = {});
  ~Sandbox();
  Sandbox(const Sandbox&) = delete;
  Sandbox& operator=(const Sandbox&) = delete;

  /// The main thread's stack: arguments and results of calls stand there.
  lua_State* stack() const { return main_; }
  const std::string& file() const { return file_; }

  /// While a function that the script calls works on the host's behalf: memory that the script has
  /// used up is no reason for the host to have none.
  class HostWork {
   public:
    explicit HostWork(Sandbox& sandbox)
        : sandbox_(sandbox), before_(std::exchange(sandbox.in_script_, false)) {}
    ~HostWork() { sandbox_.in_script_ = before_; }
    HostWork(const HostWork&) = delete;
    HostWork& operator=(const HostWork&) = delete;

   private:
    Sandbox& sandbox_;
    bool before_;
  };

  /// Makes `io` of the script: a table with these operations as functions. [] -> [io]
  void push_operations(std::initializer_list<const char*> names);

  /// Lua's own string function `name`, whatever the script has made of its table: [] -> [function]
  void push_string_function(const char* name) const;

  /// Loads the text, and runs it: [] -> [what it returns]. Throws ScriptFault.
  void run(const std::string& text);
  /// [function, arguments] -> [results]. Under a clock of real time Lua runs without the baton, so
  /// that what it takes is no other task's; null: with it. Throws ScriptFault for an error of the
  /// script, and what an operation threw and the script did not catch.
  void call(int arguments, int results, Operations* operations = nullptr, Clock* clock = nullptr);

 private:
  static void* allocate(void* user, void* block, std::size_t old_size, std::size_t new_size);
  static void count(lua_State* L, lua_Debug*);
  void open();
  int resume(lua_State* thread, int arguments, int* results);
  int carry_out(lua_State* thread, int count, Operations* operations);
  [[noreturn]] void fail(lua_State* thread, int status);
  std::string place(lua_State* thread) const;

  const std::string file_;
  const SandboxLimits limits_;
  std::size_t memory_ = 0;
  std::int64_t left_ = 0;
  bool in_script_ = false;
  lua_State* main_ = nullptr;
};

}  // namespace vitreo::scripted
