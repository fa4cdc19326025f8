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
  std::size_t memory = 16u << 20;  ///< bytes, all that the script holds
  /// Of Lua's machine, between two operations; what its library does is charged in proportion.
  std::int64_t instructions = 1'000'000;
  std::int64_t instructions_in_all = 20'000'000;  ///< of one call
  int operations = 20'000;                        ///< of one call
  Time work = std::chrono::seconds(1);            ///< of the processor, between two operations
};

/// What is wrong with a driver's own text, with file and line: "pump.lua:12: attempt to index a nil
/// value".
class ScriptFault : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Thrown by an operation of a call that has had its time: "after 10 s". The call ends with it.
class Endless : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// What the script's operations do.
class Operations {
 public:
  virtual ~Operations() = default;
  /// The arguments are all that is on L; pushes the results, and returns how many. Throws
  /// DeviceError (the script may catch it), std::invalid_argument for wrong arguments, Stopped,
  /// ScriptFault, Endless.
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
  /// The same for a text of the host's, with globals (string, math, setmetatable) that the script
  /// cannot have changed.
  void run_own(const char* text);
  /// [function, arguments] -> [results]. Under a clock of real time Lua runs without the baton, so
  /// that what it takes is no other task's; null: with it. Throws ScriptFault for an error of the
  /// script, and what an operation threw and the script did not catch.
  void call(int arguments, int results, Operations* operations = nullptr, Clock* clock = nullptr);

  /// For the library of the script: what is left of its budget, in instructions, and work that no
  /// count of them sees; an error of Lua's where that is more than is left.
  static std::int64_t left(lua_State* L);
  static void charge(lua_State* L, std::int64_t work);
  /// The same without the error, which comes with the next instruction.
  static void spend(lua_State* L, std::int64_t work);

 private:
  class Depth;
  static void* allocate(void* user, void* block, std::size_t old_size, std::size_t new_size);
  static void count(lua_State* L, lua_Debug*);
  static Sandbox& of(lua_State* L);
  void* refused();
  void give_up(lua_State* L);
  void open();
  void load(std::string_view text, const std::string& name);
  int carry_out(lua_State* thread, int count, Operations* operations);
  std::string told(lua_State* thread, const std::string& problem) const;
  int resume(lua_State* thread, int arguments, int* results);
  [[noreturn]] void fail(lua_State* thread, int status);
  std::string place(lua_State* thread) const;

  const std::string file_;
  const SandboxLimits limits_;
  std::size_t memory_ = 0;
  std::int64_t left_ = 0;
  std::int64_t left_in_all_ = 0;
  std::int64_t looked_ = 0;  // ns, when the hook first looked in this resumption; 0: not yet
  std::int64_t worked_ = 0;  // ns, the thread's processor time then
  int operations_ = 0, depth_ = 0;
  bool in_script_ = false;
  lua_State* main_ = nullptr;
};

}  // namespace vitreo::scripted
