// coroutine.*, such that a wait inside a coroutine suspends the whole task, and a stop passes
// through.
// SPDX-License-Identifier: Apache-2.0
#include "host/lua/interpreter/context.h"
#include "host/lua/interpreter/errors.h"
#include "host/lua/interpreter/scheduler.h"
#include "host/lua/interpreter/state.h"
#include "host/lua/interpreter/stop.h"

#include <stdexcept>

namespace vitreo::lua {
namespace {

/// The body runs under a pcall inside the coroutine, so that on an error its <close> variables are
/// closed at once and may wait while they are.
int end_coroutine(lua_State* L, int status, lua_KContext) {
  if (status != LUA_OK && status != LUA_YIELD) return lua_error(L);
  return lua_gettop(L);
}

/// Upvalue 1 is the script's function. By lua_pcallk, so that a wait inside it may yield across the
/// pcall.
int coroutine_body(lua_State* L) {
  lua_pushvalue(L, lua_upvalueindex(1));
  lua_insert(L, 1);
  return end_coroutine(L, lua_pcallk(L, lua_gettop(L) - 1, LUA_MULTRET, 0, 0, end_coroutine), 0);
}

/// Before its first resume a coroutine holds coroutine_body alone.
int create(lua_State* L) {
  luaL_checktype(L, 1, LUA_TFUNCTION);
  lua_State* const co = lua_newthread(L);
  lua_pushvalue(L, 1);
  lua_xmove(L, co, 1);
  lua_pushcclosure(co, coroutine_body, 1);
  return 1;
}

/// `go` runs the coroutine `co`. context.running is the state that an interrupt is armed on; both
/// sides are armed anew, since a stop may have come while the hook was on the other one.
template <class Go>
int tracked(lua_State* L, lua_State* co, const Go& go) {
  Context& context = context_of(L);
  context.running = co;
  if (context.interrupted) arm_stop(co);
  const int status = go();
  context.running = L;
  if (context.interrupted) arm_stop(L);
  return status;
}

/// Tells the two kinds of yield apart: a wait of the host has a task with a wait, a script's own
/// coroutine.yield has none.
LuaTask* waiting_task(lua_State* L) {
  Scheduler* const scheduler = context_of(L).scheduler;
  LuaTask* const task = scheduler ? scheduler->current() : nullptr;
  return task && task->wait ? task : nullptr;
}

int lua_resume_tracked(lua_State* L, lua_State* co, int arguments, int* results) {
  return tracked(L, co, [&] { return lua_resume(co, L, arguments, results); });
}

/// Resumes `co` with the arguments on top of L. The number of results now on L, -1 for an error
/// object there; kHostWait when `co` waits for the host: L must yield.
/// A stop that was felt since there were `stops` goes on, also where a <close> variable that it met
/// has yielded or returned instead.
constexpr int kError = -1, kHostWait = -2;
int go_on(lua_State* L, lua_State* co, int arguments, std::size_t stops) {
  if (!lua_checkstack(co, arguments)) return luaL_error(L, "too many arguments to resume");
  // Lua's own test of a dead coroutine: nothing to run, nothing suspended.
  if (lua_status(co) == LUA_OK && lua_gettop(co) == 0) {
    lua_pushliteral(L, "cannot resume dead coroutine");
    return kError;
  }
  lua_xmove(L, co, arguments);
  int results = 0;
  int status = lua_resume_tracked(L, co, arguments, &results);
  // A wait of the host is handed outward, level by level, until the scheduler has it. Where that is
  // not possible, as within table.sort, the wait itself fails inside the coroutine, where the
  // script can catch it.
  while (status == LUA_YIELD && waiting_task(L)) {
    lua_pop(co, results);
    if (lua_isyieldable(L)) return kHostWait;
    waiting_task(L)->error = std::make_exception_ptr(std::runtime_error(
        "cannot wait here: this coroutine was resumed inside a function that Lua cannot suspend"));
    status = lua_resume_tracked(L, co, 0, &results);
  }
  let_stop_pass(L, stops);
  if (status == LUA_OK || status == LUA_YIELD) {
    luaL_checkstack(L, results + 1, "too many results to resume");
    lua_xmove(co, L, results);
    return results;
  }
  lua_xmove(co, L, 1);
  // A stop is no error for the script to see: it goes on through resume.
  if (is_stop(L, -1)) return lua_error(L);
  return kError;
}

/// Lua's own message for an argument of another type.
lua_State* coroutine_at(lua_State* L, int index) {
  lua_State* const co = lua_tothread(L, index);
  luaL_argexpected(L, co, index, "coroutine");
  return co;
}

int continue_resume(lua_State* L, int, lua_KContext);

/// The coroutine stays at index 1 through all waits, and with them the number of stops from before
/// the first. As coroutine.resume: true and the results, or false and the error.
int resume_with(lua_State* L, int arguments, lua_KContext stops) {
  const int results = go_on(L, coroutine_at(L, 1), arguments, static_cast<std::size_t>(stops));
  if (results == kHostWait) {
    lua_settop(L, 1);
    return lua_yieldk(L, 0, stops, continue_resume);
  }
  lua_pushboolean(L, results != kError);
  const int count = results == kError ? 1 : results;
  lua_insert(L, -1 - count);
  return count + 1;
}

/// Entered anew after each wait of the host; what was passed to resume has been passed already.
int continue_resume(lua_State* L, int, lua_KContext stops) { return resume_with(L, 0, stops); }
int resume(lua_State* L) {
  coroutine_at(L, 1);
  return resume_with(L, lua_gettop(L) - 1, static_cast<lua_KContext>(stops_felt(L)));
}

int continue_wrapped(lua_State* L, int, lua_KContext);

/// As resume_with, but errors go on. The coroutine is upvalue 1.
int wrapped_with(lua_State* L, int arguments, lua_KContext stops) {
  const int results =
      go_on(L, lua_tothread(L, lua_upvalueindex(1)), arguments, static_cast<std::size_t>(stops));
  if (results == kHostWait) {
    lua_settop(L, 0);
    return lua_yieldk(L, 0, stops, continue_wrapped);
  }
  if (results == kError) return lua_error(L);
  return results;
}

int continue_wrapped(lua_State* L, int, lua_KContext stops) { return wrapped_with(L, 0, stops); }
int wrapped(lua_State* L) {
  return wrapped_with(L, lua_gettop(L), static_cast<lua_KContext>(stops_felt(L)));
}

int wrap(lua_State* L) {
  create(L);
  lua_pushcclosure(L, wrapped, 1);
  return 1;
}

/// To Lua a task of the scheduler is a coroutine as well; a yield from its body would be taken for
/// a wait.
int yield(lua_State* L) {
  const Scheduler* const scheduler = context_of(L).scheduler;
  if (scheduler && scheduler->current() && scheduler->current()->thread == L)
    return luaL_error(L, "attempt to yield from outside a coroutine");
  return lua_yield(L, lua_gettop(L));
}

/// As Lua's own, but a stop that its <close> variables met goes on. They cannot wait here:
/// lua_resetthread does not yield. (Debian's Lua 5.4.4 has no lua_closethread.)
int close(lua_State* L) {
  lua_State* const co = coroutine_at(L, 1);
  lua_Debug frame;
  const bool runs = co == L || (lua_status(co) == LUA_OK && lua_getstack(co, 0, &frame));
  if (runs) return luaL_error(L, "cannot close a running coroutine");
  const std::size_t stops = stops_felt(L);
  const int status = tracked(L, co, [co] { return lua_resetthread(co); });
  let_stop_pass(L, stops);
  if (status == LUA_OK) {
    lua_pushboolean(L, 1);
    return 1;
  }
  lua_pushboolean(L, 0);
  lua_xmove(co, L, 1);
  if (is_stop(L, -1)) return lua_error(L);
  return 2;
}

}  // namespace

/// Over Lua's own library, of which isyieldable, running and status stay.
void open_coroutines(lua_State* L) {
  luaL_requiref(L, LUA_COLIBNAME, luaopen_coroutine, 1);
  const luaL_Reg own[] = {{"create", create}, {"resume", resume}, {"wrap", wrap},
                          {"yield", yield},   {"close", close},   {nullptr, nullptr}};
  luaL_setfuncs(L, own, 0);
  lua_pop(L, 1);
}

}  // namespace vitreo::lua
