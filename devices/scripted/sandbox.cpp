// SPDX-License-Identifier: Apache-2.0
#include "devices/scripted/sandbox.h"

#include "devices/time/error.h"

#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <new>
#include <optional>
#include <utility>

namespace vitreo::scripted {
namespace {

/// Between two looks at the budget.
constexpr int kStep = 1000;
constexpr std::size_t kHeadroom = 8u << 20;  // bytes
constexpr int kMostArguments = 250;          // of an operation
constexpr const char* kFailure = "vitreo.failure";
constexpr const char* kStrings = "vitreo.strings";

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

void open_libraries(lua_State* L) {
  const luaL_Reg libraries[] = {{LUA_GNAME, luaopen_base},
                                {LUA_TABLIBNAME, luaopen_table},
                                {LUA_STRLIBNAME, luaopen_string},
                                {LUA_MATHLIBNAME, luaopen_math},
                                {nullptr, nullptr}};
  for (const luaL_Reg* library = libraries; library->func != nullptr; ++library) {
    luaL_requiref(L, library->name, library->func, 1);
    lua_pop(L, 1);
  }
  for (const char* name : {"dofile", "loadfile", "load", "collectgarbage", "warn", "print",
                           "getmetatable", "rawset", "xpcall"}) {
    lua_pushnil(L);
    lua_setglobal(L, name);
  }
  lua_getglobal(L, LUA_STRLIBNAME);
  lua_pushnil(L);
  lua_setfield(L, -2, "dump");
  lua_pop(L, 1);
  lua_getglobal(L, LUA_MATHLIBNAME);  // a run is the same each time
  for (const char* name : {"random", "randomseed"}) {
    lua_pushnil(L);
    lua_setfield(L, -2, name);
  }
  lua_pop(L, 1);
}

}  // namespace

struct Reference::Held {
  lua_State* L;
  int number;
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
  const std::size_t limit = sandbox.limits_.memory + (sandbox.in_script_ ? 0 : kHeadroom);
  if (new_size > old_size && sandbox.memory_ + (new_size - old_size) > limit) return nullptr;
  void* const moved = std::realloc(block, new_size);
  if (moved != nullptr) sandbox.memory_ += new_size - old_size;
  return moved;
}

// Past the budget each look raises the error anew: a script that catches it comes no further.
void Sandbox::count(lua_State* L, lua_Debug*) {
  Sandbox& sandbox = **static_cast<Sandbox**>(lua_getextraspace(L));
  sandbox.left_ -= kStep;
  if (sandbox.left_ > 0) return;
  lua_sethook(L, count, LUA_MASKCOUNT, 1);
  luaL_error(L, "it works for too long without an operation: more than %d instructions",
             static_cast<int>(sandbox.limits_.instructions));
}

Sandbox::Sandbox(const std::string& file, const SandboxLimits& limits)
    : file_(file), limits_(limits) {
  main_ = lua_newstate(allocate, this);
  if (main_ == nullptr) throw std::bad_alloc();
  *static_cast<Sandbox**>(lua_getextraspace(main_)) = this;  // threads copy it
  open();
}

Sandbox::~Sandbox() { lua_close(main_); }

void Sandbox::open() {
  open_libraries(main_);
  open_failures(main_);
  luaopen_string(main_);  // a second table of the same functions, out of the script's reach
  lua_setfield(main_, LUA_REGISTRYINDEX, kStrings);
  lua_pushglobaltable(main_);
  lua_newtable(main_);
  lua_pushcfunction(main_, unknown_global);
  lua_setfield(main_, -2, "__index");
  lua_pushboolean(main_, 0);
  lua_setfield(main_, -2, "__metatable");
  lua_setmetatable(main_, -2);
  lua_settop(main_, 0);
}

void Sandbox::push_string_function(const char* name) const {
  lua_getfield(main_, LUA_REGISTRYINDEX, kStrings);
  lua_getfield(main_, -1, name);
  lua_remove(main_, -2);
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

void Sandbox::run(const std::string& text) {
  std::string_view source = text;
  if (source.starts_with("\xEF\xBB\xBF")) source.remove_prefix(3);
  if (luaL_loadbufferx(main_, source.data(), source.size(), ("@" + file_).c_str(), "t") != LUA_OK) {
    const std::string problem = lua_tostring(main_, -1);
    lua_pop(main_, 1);
    throw ScriptFault(problem);
  }
  call(0, 1);
}

/// "pump.lua:12: " of the innermost function of the file that runs on the thread.
std::string Sandbox::place(lua_State* thread) const {
  lua_Debug frame;
  for (int level = 0; lua_getstack(thread, level, &frame) != 0; ++level) {
    lua_getinfo(thread, "Sl", &frame);
    if (frame.currentline > 0) return file_ + ":" + std::to_string(frame.currentline) + ": ";
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
  std::string problem =
      words == nullptr ? place(thread) + "it raised a " + luaL_typename(thread, -1) + " as an error"
                       : std::string(words, std::min<std::size_t>(size, 500));
  throw ScriptFault(problem.starts_with(file_) ? problem : place(thread) + problem);
}

int Sandbox::resume(lua_State* thread, int arguments, int* results) {
  left_ = limits_.instructions;
  lua_sethook(thread, count, LUA_MASKCOUNT, kStep);
  in_script_ = true;
  const int status = lua_resume(thread, nullptr, arguments, results);
  in_script_ = false;
  return status;
}

/// What the thread yielded, the operation's name and its arguments, is taken; what it is to go on
/// with is left on it. How many values these are.
int Sandbox::carry_out(lua_State* thread, int count, Operations* operations) {
  const std::string name = lua_tostring(thread, -count);
  lua_State* const L = lua_newthread(main_);  // a stack for the operation alone
  const Reference kept(main_);
  if (count > kMostArguments || lua_checkstack(L, count + LUA_MINSTACK) == 0)
    throw ScriptFault(place(thread) + "io:" + name + ": has too many arguments");
  lua_xmove(thread, L, count - 1);
  lua_pop(thread, 1);
  try {
    if (operations == nullptr) throw std::invalid_argument("io:" + name + " cannot be called here");
    const int pushed = operations->perform(name, L);
    if (lua_checkstack(thread, pushed + LUA_MINSTACK) == 0) throw std::bad_alloc();
    lua_pushboolean(thread, 1);
    lua_xmove(L, thread, pushed);
    return pushed + 1;
  } catch (const Stopped&) {
    throw;
  } catch (const std::invalid_argument& wrong) {
    const std::string problem = place(thread) + "io:" + name + ": " + wrong.what();
    lua_pushboolean(thread, 0);
    lua_pushlstring(thread, problem.data(), problem.size());
    return 2;
  } catch (...) {
    lua_pushboolean(thread, 0);
    push_failure(thread, std::current_exception());
    return 2;
  }
}

// A coroutine of its own each time: it is suspended in each operation, which is carried out here,
// outside of Lua, where it may wait and throw.
void Sandbox::call(int arguments, int results, Operations* operations, Clock* clock) {
  lua_State* const thread = lua_newthread(main_);
  const Reference alive(main_);
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

}  // namespace vitreo::scripted
