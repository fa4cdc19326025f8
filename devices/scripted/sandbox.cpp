// SPDX-License-Identifier: Apache-2.0
#include "devices/scripted/sandbox.h"

#include "devices/scripted/budget.h"
#include "devices/scripted/library.h"
#include "devices/time/error.h"

#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <new>
#include <utility>

namespace vitreo::scripted {
namespace {

/// Instructions between two looks at the budget.
constexpr int kStep = 200;
constexpr std::size_t kLargestBlock = 4u << 20;  // bytes, of one text or table
constexpr std::int64_t kBytesOfWork = 256;       // to get so many is the work of an instruction
constexpr std::int64_t kRefused = 20000;         // instructions: all memory is gone through then
constexpr std::size_t kHeadroom = 8u << 20;      // bytes
constexpr int kMostArguments = 250;              // of an operation
constexpr const char* kFailure = "vitreo.failure";
constexpr const char* kOwn = "vitreo.own";

/// What an operation threw, as an error value of Lua's: a script that does not catch it hands it on
/// unchanged.
struct Failure {
  std::exception_ptr thrown;
};

int collect_failure(lua_State* L) {
  static_cast<Failure*>(lua_touserdata(L, 1))->~Failure();
  return 0;
}

std::string text_of(const std::exception_ptr& thrown) {
  try {
    std::rethrow_exception(thrown);
  } catch (const std::exception& error) {
    return error.what();
  }
}

int failure_text(lua_State* L) {
  lua_pushstring(L, text_of(static_cast<Failure*>(lua_touserdata(L, 1))->thrown).c_str());
  return 1;
}

/// error.kind: "timeout", "lost"; nil of what no device reported.
int failure_field(lua_State* L) {
  if (lua_type(L, 2) == LUA_TSTRING && std::strcmp(lua_tostring(L, 2), "kind") == 0) {
    try {
      std::rethrow_exception(static_cast<Failure*>(lua_touserdata(L, 1))->thrown);
    } catch (const DeviceError& error) {
      lua_pushstring(L, to_string(error.kind));
      return 1;
    } catch (...) {  // of another kind
    }
  }
  return 0;
}

void push_failure(lua_State* L, std::exception_ptr thrown) {
  new (lua_newuserdatauv(L, sizeof(Failure), 0)) Failure{std::move(thrown)};
  luaL_setmetatable(L, kFailure);
}

/// Where an operation ends: its results are on the stack behind whether it went well.
int ended(lua_State* L, int, lua_KContext base) {
  const int first = static_cast<int>(base) + 1;
  if (lua_toboolean(L, first) == 0) return lua_error(L);  // the failure on top
  return lua_gettop(L) - first;
}

/// io:ask(...): yields the operation's name and its arguments, without the table itself.
int operation(lua_State* L) {
  if (lua_gettop(L) > 0 && lua_rawequal(L, 1, lua_upvalueindex(2)) != 0) {
    lua_remove(L, 1);
  } else {
    return luaL_error(L, "io.%s is called with a colon: io:%s(...)",
                      lua_tostring(L, lua_upvalueindex(1)), lua_tostring(L, lua_upvalueindex(1)));
  }
  if (lua_isyieldable(L) == 0)
    return luaL_error(L, "io:%s cannot be called here", lua_tostring(L, lua_upvalueindex(1)));
  lua_pushvalue(L, lua_upvalueindex(1));
  lua_insert(L, 1);
  return lua_yieldk(L, lua_gettop(L), 0, ended);
}

int unknown_global(lua_State* L) {
  return luaL_error(L, "%s is not known in an instrument's file", lua_tostring(L, 2));
}

void open_failures(lua_State* L) {
  luaL_newmetatable(L, kFailure);
  const luaL_Reg rows[] = {{"__gc", collect_failure},
                           {"__tostring", failure_text},
                           {"__index", failure_field},
                           {nullptr, nullptr}};
  luaL_setfuncs(L, rows, 0);
  lua_pushstring(L, "failure");
  lua_setfield(L, -2, "__metatable");
  lua_pop(L, 1);
}

/// A table of its own with the functions of a library, as they are now: [] -> [table]
void push_copy(lua_State* L, const char* library) {
  lua_newtable(L);
  lua_getglobal(L, library);
  lua_pushnil(L);
  while (lua_next(L, -2) != 0) {
    lua_pushvalue(L, -2);
    lua_insert(L, -2);
    lua_rawset(L, -5);
  }
  lua_pop(L, 1);
}

std::int64_t nanoseconds(clockid_t which) {
  timespec now{};
  clock_gettime(which, &now);
  return now.tv_sec * 1'000'000'000 + now.tv_nsec;
}

}  // namespace

struct Reference::Held {
  lua_State* L;
  int number;
  Held(lua_State* main, int its) : L(main), number(its) {}
  Held(const Held&) = delete;
  Held& operator=(const Held&) = delete;
  ~Held() { luaL_unref(L, LUA_REGISTRYINDEX, number); }
};

// The main thread outlives the coroutine on whose stack the value may stand.
Reference::Reference(lua_State* L) {
  const int number = luaL_ref(L, LUA_REGISTRYINDEX);
  lua_rawgeti(L, LUA_REGISTRYINDEX, LUA_RIDX_MAINTHREAD);
  lua_State* const main = lua_tothread(L, -1);
  lua_pop(L, 1);
  held_ = std::make_shared<Held>(main, number);
}

void Reference::push() const { lua_rawgeti(held_->L, LUA_REGISTRYINDEX, held_->number); }

void* Sandbox::allocate(void* user, void* block, std::size_t old_size, std::size_t new_size) {
  Sandbox& sandbox = *static_cast<Sandbox*>(user);
  if (block == nullptr) old_size = 0;  // for new objects Lua gives their type here
  if (new_size == 0) {
    std::free(block);
    sandbox.memory_ -= old_size;
    return nullptr;
  }
  // Outside of a call an error of Lua's has no handler: the host's own pushes have room to spare.
  // What shrinks is never refused: a collection must be able to go on at the limit.
  const std::size_t limit = sandbox.limits_.memory + (sandbox.in_script_ ? 0 : kHeadroom);
  if (new_size > old_size && sandbox.memory_ + (new_size - old_size) > limit)
    return sandbox.refused();
  if (sandbox.in_script_ && new_size > old_size) {
    if (new_size > kLargestBlock) return sandbox.refused();
    sandbox.left_ -= static_cast<std::int64_t>((new_size - old_size) / kBytesOfWork);
  }
  void* const moved = std::realloc(block, new_size);
  if (moved != nullptr) sandbox.memory_ += new_size - old_size;
  return moved;
}

void* Sandbox::refused() {
  left_ -= kRefused;
  return nullptr;
}

Sandbox& Sandbox::of(lua_State* L) { return **static_cast<Sandbox**>(lua_getextraspace(L)); }

std::int64_t Sandbox::left(lua_State* L) { return std::max<std::int64_t>(of(L).left_, 0); }

void Sandbox::spend(lua_State* L, std::int64_t work) { of(L).left_ -= work; }

void Sandbox::charge(lua_State* L, std::int64_t work) {
  spend(L, work);
  if (of(L).left_ <= 0) of(L).give_up(L);
}

// Past the budget each look raises the error anew: a script that catches it comes no further.
void Sandbox::give_up(lua_State* L) {
  lua_sethook(L, count, LUA_MASKCOUNT, 1);
  if (left_in_all_ < limits_.instructions)
    luaL_error(L, "it works for too long: more than %I instructions in all",
               static_cast<lua_Integer>(limits_.instructions_in_all));
  luaL_error(L, "it works for too long without an operation: more than %I instructions",
             static_cast<lua_Integer>(limits_.instructions));
}

// The instructions are the same each time; the time is for what a few of them can make, such as
// comparing texts of megabytes. Processor time, or a busy computer would be the script's fault.
void Sandbox::count(lua_State* L, lua_Debug*) {
  Sandbox& sandbox = of(L);
  charge(L, kStep);
  const std::int64_t now = nanoseconds(CLOCK_MONOTONIC);
  if (sandbox.looked_ == 0) {
    sandbox.looked_ = now;
    sandbox.worked_ = nanoseconds(CLOCK_THREAD_CPUTIME_ID);
  }
  if (now - sandbox.looked_ < sandbox.limits_.work.count()) return;
  if (nanoseconds(CLOCK_THREAD_CPUTIME_ID) - sandbox.worked_ < sandbox.limits_.work.count()) return;
  sandbox.left_ = 0;
  sandbox.give_up(L);
}

Sandbox::Sandbox(const std::string& file, const SandboxLimits& limits)
    : file_(file), limits_(limits) {
  // luaL_newstate() would take an allocator that counts nothing.
  main_ = lua_newstate(allocate, this);
  if (main_ == nullptr) throw std::bad_alloc();
  *static_cast<Sandbox**>(lua_getextraspace(main_)) = this;  // threads copy it
  open();
}

Sandbox::~Sandbox() { lua_close(main_); }

void Sandbox::open() {
  open_library(main_);
  open_failures(main_);
  lua_newtable(main_);  // the host's own globals, out of the script's reach
  for (const char* library : {LUA_STRLIBNAME, LUA_MATHLIBNAME}) {
    push_copy(main_, library);
    lua_setfield(main_, -2, library);
  }
  lua_getglobal(main_, "setmetatable");
  lua_setfield(main_, -2, "setmetatable");
  lua_setfield(main_, LUA_REGISTRYINDEX, kOwn);
  lua_pushglobaltable(main_);
  lua_newtable(main_);
  lua_pushcfunction(main_, unknown_global);
  lua_setfield(main_, -2, "__index");
  // A __metatable of false: the file can neither see nor replace the one of its globals.
  lua_pushboolean(main_, 0);
  lua_setfield(main_, -2, "__metatable");
  lua_setmetatable(main_, -2);
  lua_settop(main_, 0);
}

void Sandbox::push_string_function(const char* name) const {
  lua_getfield(main_, LUA_REGISTRYINDEX, kOwn);
  lua_getfield(main_, -1, LUA_STRLIBNAME);
  lua_getfield(main_, -1, name);
  lua_replace(main_, -3);
  lua_pop(main_, 1);
}

void Sandbox::push_operations(std::initializer_list<const char*> names) {
  lua_newtable(main_);
  for (const char* name : names) {
    lua_pushstring(main_, name);
    lua_pushvalue(main_, -2);
    lua_pushcclosure(main_, operation, 2);
    lua_setfield(main_, -2, name);
  }
}

void Sandbox::load(std::string_view text, const std::string& name) {
  // "t": texts alone. Precompiled chunks can break out of Lua's machine.
  if (luaL_loadbufferx(main_, text.data(), text.size(), name.c_str(), "t") == LUA_OK) return;
  const ScriptFault fault(told(main_, lua_tostring(main_, -1)));
  lua_pop(main_, 1);
  throw fault;
}

void Sandbox::run(const std::string& text) {
  std::string_view source = text;
  if (source.starts_with("\xEF\xBB\xBF")) source.remove_prefix(3);
  load(source, "@" + file_);
  call(0, 1);
}

void Sandbox::run_own(const char* text) {
  load(text, "=host");
  lua_getfield(main_, LUA_REGISTRYINDEX, kOwn);
  lua_setupvalue(main_, -2, 1);  // its globals
  call(0, 1);
}

/// "pump.lua:12: " of the innermost function of the file that runs on the thread.
std::string Sandbox::place(lua_State* thread) const {
  lua_Debug frame;
  for (int level = 0; lua_getstack(thread, level, &frame) != 0; ++level) {
    lua_getinfo(thread, "Sl", &frame);
    if (frame.currentline > 0 && frame.source[0] == '@')
      return file_ + ":" + std::to_string(frame.currentline) + ": ";
  }
  return file_ + ": ";
}

void Sandbox::fail(lua_State* thread, int status) {
  if (status == LUA_ERRMEM)
    throw ScriptFault(place(thread) + "it takes more memory than it may: " +
                      std::to_string(limits_.memory >> 20) + " MB");
  if (auto* const failure = static_cast<Failure*>(luaL_testudata(thread, -1, kFailure)))
    std::rethrow_exception(failure->thrown);
  std::size_t size = 0;
  const char* const words = lua_tolstring(thread, -1, &size);
  throw ScriptFault(
      words == nullptr ? place(thread) + "it raised a " + luaL_typename(thread, -1) + " as an error"
                       : told(thread, std::string(words, std::min<std::size_t>(size, 500))));
}

/// With the file's whole name, which Lua cuts to 60 bytes, and with a line where there is none.
std::string Sandbox::told(lua_State* thread, const std::string& problem) const {
  if (problem.starts_with(file_)) return problem;
  if (file_.size() > LUA_IDSIZE - 2 && problem.starts_with("...")) {
    const std::size_t end = problem.find(':', 3);
    if (end != std::string::npos && file_.ends_with(problem.substr(3, end - 3)))
      return file_ + problem.substr(end);
  }
  return place(thread) + problem;
}

int Sandbox::resume(lua_State* thread, int arguments, int* results) {
  const std::int64_t given = std::min(limits_.instructions, left_in_all_);
  left_ = given;
  looked_ = 0;
  lua_sethook(thread, count, LUA_MASKCOUNT, kStep);
  in_script_ = true;
  const int status = lua_resume(thread, nullptr, arguments, results);
  in_script_ = false;
  // At least one for each resumption, so that a loop of operations ends, too.
  left_in_all_ -= std::min(given, given - left_ + 1);
  return status;
}

/// What a call has in all; one within an operation of another has what that one still has.
class Sandbox::Depth {
 public:
  explicit Depth(Sandbox& sandbox) : sandbox_(sandbox) {
    if (sandbox_.depth_++ > 0) return;
    sandbox_.left_in_all_ = sandbox_.limits_.instructions_in_all;
    sandbox_.operations_ = 0;
  }
  ~Depth() { --sandbox_.depth_; }
  Depth(const Depth&) = delete;
  Depth& operator=(const Depth&) = delete;

 private:
  Sandbox& sandbox_;
};

// A coroutine of its own each time: it is suspended in each operation, which is carried out here,
// outside of Lua, where it may wait and throw.
void Sandbox::call(int arguments, int results, Operations* operations, Clock* clock) {
  const Depth depth(*this);
  lua_State* const thread = lua_newthread(main_);
  const Reference alive(main_);
  if (arguments > kMostArguments || lua_checkstack(thread, arguments + LUA_MINSTACK) == 0)
    throw ScriptFault(file_ + ": a function would have too many arguments");
  // The function stands below its arguments.
  lua_xmove(main_, thread, arguments + 1);
  int given = arguments;
  for (;;) {
    int count = 0;
    int status = LUA_OK;
    const auto work = [&] { status = resume(thread, given, &count); };
    if (clock != nullptr) {
      clock->outside(work);
    } else {
      work();
    }
    if (status == LUA_OK) break;
    if (status != LUA_YIELD) fail(thread, status);
    given = carry_out(thread, count, operations);
  }
  lua_settop(thread, results);
  lua_xmove(thread, main_, results);
}

/// One operation. [name, arguments] -> [whether it went well, its results or the error]; their
/// number. What is wrong with the file, and a stop, end the call: the script cannot catch them.
int Sandbox::carry_out(lua_State* thread, int count, Operations* operations) {
  const std::string name = lua_tostring(thread, -count);
  if (++operations_ > limits_.operations || left_in_all_ <= 0)
    throw ScriptFault(place(thread) + "it does not end: io:" + name + " after " +
                      std::to_string(operations_ - 1) + " operations");
  lua_State* const L = lua_newthread(main_);  // a stack for the operation alone
  const Reference kept(main_);
  if (count > kMostArguments || lua_checkstack(L, count + LUA_MINSTACK) == 0)
    throw ScriptFault(place(thread) + "io:" + name + ": has too many arguments");
  lua_xmove(thread, L, count - 1);
  lua_pop(thread, 1);
  try {
    if (operations == nullptr) throw std::invalid_argument("cannot be called here");
    const int pushed = operations->perform(name, L);
    if (lua_checkstack(thread, pushed + LUA_MINSTACK) == 0) throw std::bad_alloc();
    lua_pushboolean(thread, 1);
    lua_xmove(L, thread, pushed);
    return pushed + 1;
  } catch (const Stopped&) {
    throw;
  } catch (const Endless& late) {
    throw ScriptFault(place(thread) + "it does not end: io:" + name + " " + late.what());
  } catch (const ScriptFault&) {
    throw;
  } catch (const std::invalid_argument& wrong) {
    const std::string problem = place(thread) + "io:" + name + ": " + wrong.what();
    lua_pushboolean(thread, 0);
    lua_pushlstring(thread, problem.data(), problem.size());
  } catch (...) {
    lua_pushboolean(thread, 0);
    push_failure(thread, std::current_exception());
  }
  return 2;
}

std::int64_t budget::left(lua_State* L) { return Sandbox::left(L); }
void budget::charge(lua_State* L, std::int64_t work) { Sandbox::charge(L, work); }
void budget::spend(lua_State* L, std::int64_t work) { Sandbox::spend(L, work); }

}  // namespace vitreo::scripted
