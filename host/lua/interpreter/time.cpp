// os.* reads the Clock, math.random the run's seed: the same in every run.
// SPDX-License-Identifier: Apache-2.0
#include "host/lua/interpreter/context.h"
#include "host/lua/interpreter/errors.h"
#include "host/lua/interpreter/state.h"

#include <cmath>

namespace vitreo::lua {
namespace {

/// Of the run's clock: simulated seconds in a simulated run.
double seconds(lua_State* L) { return to_seconds(session_of(L).clock.now()); }

/// Lua's own counts processor time, which differs from run to run.
int clock(lua_State* L) {
  return guarded(L, "os.clock: ", [L] {
    lua_pushnumber(L, seconds(L));
    return 1;
  });
}

/// os.time() without a table; with one it is plain arithmetic and stays Lua's own (upvalue 1).
int time(lua_State* L) {
  if (!lua_isnoneornil(L, 1)) {
    lua_pushvalue(L, lua_upvalueindex(1));
    lua_pushvalue(L, 1);
    lua_call(L, 1, 1);
    return 1;
  }
  return guarded(L, "os.time: ", [L] {
    lua_pushinteger(L, static_cast<lua_Integer>(std::floor(seconds(L))));
    return 1;
  });
}

/// os.date([format [, time]]) in UTC, from Lua's own (upvalue 1).
int date(lua_State* L) {
  const std::string format = luaL_optstring(L, 1, "%c");
  lua_settop(L, 2);
  if (lua_isnil(L, 2)) {
    guarded(L, "os.date: ", [L] {
      lua_pushinteger(L, static_cast<lua_Integer>(std::floor(seconds(L))));
      return 1;
    });
    lua_replace(L, 2);
  }
  lua_pushvalue(L, lua_upvalueindex(1));
  // "!" is Lua's sign for UTC; the machine's time zone has no part in a run.
  lua_pushstring(L, (format.starts_with("!") ? format : "!" + format).c_str());
  lua_pushvalue(L, 2);
  lua_call(L, 2, 1);
  return 1;
}

/// math.randomseed(): without arguments Lua would take an address and the wall clock.
/// With numbers of its own a script gets its own sequence, the same in each run.
int seed(lua_State* L) {
  if (lua_isnone(L, 1)) lua_pushinteger(L, static_cast<lua_Integer>(context_of(L).seed));
  lua_pushvalue(L, lua_upvalueindex(1));
  lua_insert(L, 1);
  lua_call(L, lua_gettop(L) - 1, 0);
  return 0;
}

/// Copies one function from the old library into the new one; `own`, where given, wraps it.
void keep(lua_State* L, const char* name, lua_CFunction own) {
  lua_getfield(L, -2, name);  // below: the old library, the new one
  if (own) lua_pushcclosure(L, own, 1);
  lua_setfield(L, -2, name);
}

}  // namespace

/// Of os only what reads a clock is kept: no execute, remove, rename, exit or getenv. It is taken
/// out of the loaded modules too, so that no require brings it back.
void open_time(lua_State* L) {
  luaL_requiref(L, LUA_OSLIBNAME, luaopen_os, 0);
  lua_newtable(L);
  keep(L, "time", time);
  keep(L, "date", date);
  keep(L, "clock", clock);
  keep(L, "difftime", nullptr);
  lua_setglobal(L, LUA_OSLIBNAME);
  lua_getfield(L, LUA_REGISTRYINDEX, LUA_LOADED_TABLE);
  lua_pushnil(L);
  lua_setfield(L, -2, LUA_OSLIBNAME);
  lua_pop(L, 2);
  lua_getglobal(L, LUA_MATHLIBNAME);
  lua_getfield(L, -1, "randomseed");
  lua_pushcclosure(L, seed, 1);
  lua_pushvalue(L, -1);
  lua_setfield(L, -3, "randomseed");
  // Seeded at once, so that a script that never seeds is repeatable too.
  lua_call(L, 0, 0);
  lua_pop(L, 1);
}

}  // namespace vitreo::lua
