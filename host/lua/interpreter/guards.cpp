// pcall, xpcall and what else could swallow a stop; load without bytecode; setmetatable without
// finalizers.
// SPDX-License-Identifier: Apache-2.0
#include "host/lua/interpreter/context.h"
#include "host/lua/interpreter/state.h"
#include "host/lua/interpreter/stop.h"

#include <utility>

namespace vitreo::lua {
namespace {

/// Also entered after a wait inside the call. On success the true that was pushed first stands
/// below the results. A stop is never an error that pcall returns.
int end_protected(lua_State* L, int status, lua_KContext stops_before) {
  let_stop_pass(L, static_cast<std::size_t>(stops_before));
  if (status == LUA_OK || status == LUA_YIELD) return lua_gettop(L);
  if (is_stop(L, -1)) return lua_error(L);
  Context& context = context_of(L);
  if (std::exchange(context.short_of_memory, false))
    lua_gc(L, LUA_GCCOLLECT);  // what filled it may be garbage by now
  lua_pushboolean(L, 0);
  lua_insert(L, -2);
  return 2;
}

/// The handler at index 1 is no result; on an error end_protected() returns its own two.
int end_protected_with_handler(lua_State* L, int status, lua_KContext stops_before) {
  const int results = end_protected(L, status, stops_before);
  return status == LUA_OK || status == LUA_YIELD ? results - 1
                                                 : results;  // the handler stands below
}

/// As Lua's, but a wait may yield across it and a stop passes through.
int protected_call(lua_State* L) {
  luaL_checkany(L, 1);
  lua_pushboolean(L, 1);
  lua_insert(L, 1);
  const auto stops = static_cast<lua_KContext>(stops_felt(L));
  return end_protected(L, lua_pcallk(L, lua_gettop(L) - 2, LUA_MULTRET, 0, stops, end_protected),
                       stops);
}

/// The script's handler, upvalue 1, does not see a stop: what it returned would replace it.
int handle_error(lua_State* L) {
  if (is_stop(L, 1)) return 1;
  lua_settop(L, 1);
  lua_pushvalue(L, lua_upvalueindex(1));
  lua_insert(L, 1);
  lua_call(L, 1, 1);
  return 1;
}

/// xpcall(f, handler, ...): the stack becomes handler, true, f, ...
int protected_call_with_handler(lua_State* L) {
  luaL_checktype(L, 2, LUA_TFUNCTION);
  lua_pushvalue(L, 2);
  lua_pushcclosure(L, handle_error, 1);
  lua_replace(L, 2);
  lua_pushvalue(L, 1);  // f, handler, ..., f
  lua_insert(L, 3);     // f, handler, f, ...
  lua_pushvalue(L, 2);
  lua_replace(L, 1);  // handler, handler, f, ...
  lua_pushboolean(L, 1);
  lua_replace(L, 2);  // handler, true, f, ...
  const auto stops = static_cast<lua_KContext>(stops_felt(L));
  const int status =
      lua_pcallk(L, lua_gettop(L) - 3, LUA_MULTRET, 1, stops, end_protected_with_handler);
  return end_protected_with_handler(L, status, stops);
}

/// Finalizers run when the collector pleases: not the same in each run, and deaf to a stop.
int set_metatable(lua_State* L) {
  luaL_checktype(L, 1, LUA_TTABLE);
  luaL_argexpected(L, lua_isnil(L, 2) || lua_istable(L, 2), 2, "nil or table");
  if (luaL_getmetafield(L, 1, "__metatable") != LUA_TNIL)
    return luaL_error(L, "cannot change a protected metatable");
  if (lua_istable(L, 2)) {
    lua_pushliteral(L, "__gc");
    if (lua_rawget(L, 2) != LUA_TNIL)
      return luaL_error(L, "setmetatable: __gc is not available; use <close> or run:defer");
    lua_pop(L, 1);
  }
  lua_settop(L, 2);
  lua_setmetatable(L, 1);
  return 1;
}

/// Text only, since bytecode can crash the interpreter. No reader functions: the whole text is
/// known before it is compiled.
int load(lua_State* L) {
  if (lua_type(L, 1) != LUA_TSTRING)
    return luaL_error(L, "load: wants a string, got %s", luaL_typename(L, 1));
  std::size_t size = 0;
  const char* const text = lua_tolstring(L, 1, &size);
  // No stop is felt while it is compiled.
  constexpr std::size_t kLongest = 1 << 20;
  if (size > kLongest) return luaL_error(L, "load: the text is longer than 1 MB");
  const bool has_environment = !lua_isnone(L, 4);
  if (luaL_loadbufferx(L, text, size, luaL_optstring(L, 2, "=(load)"), "t") != LUA_OK) {
    lua_pushnil(L);
    lua_insert(L, -2);
    return 2;
  }
  // The chunk's first upvalue is its environment; one that uses no global has none.
  if (has_environment) {
    lua_pushvalue(L, 4);
    if (!lua_setupvalue(L, -2, 1)) lua_pop(L, 1);
  }
  return 1;
}

}  // namespace

/// Before any script runs, so none can hold the originals.
void open_guards(lua_State* L) {
  const luaL_Reg own[] = {{"pcall", protected_call},
                          {"xpcall", protected_call_with_handler},
                          {"load", load},
                          {"setmetatable", set_metatable},
                          {nullptr, nullptr}};
  lua_pushglobaltable(L);
  luaL_setfuncs(L, own, 0);
  lua_pop(L, 1);
}

}  // namespace vitreo::lua
