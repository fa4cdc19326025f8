// Repeatable order of what in plain Lua depends on addresses and hashes: pairs, next,
// tostring, string.format.
// SPDX-License-Identifier: Apache-2.0
#include "host/lua/interpreter/context.h"
#include "host/lua/interpreter/errors.h"
#include "host/lua/interpreter/state.h"
#include "host/lua/interpreter/turn.h"
#include "host/lua/interpreter/values.h"

#include <cctype>
#include <stdexcept>

namespace vitreo::lua {
namespace {

/// Upvalues: the keys in their order, how many were given.
/// The keys are those at the start of the loop: one that is added on the way is not visited, one
/// that is taken out is skipped.
int next_of_keys(lua_State* L) {
  lua_Integer at = lua_tointeger(L, lua_upvalueindex(2));
  const auto count = static_cast<lua_Integer>(lua_rawlen(L, lua_upvalueindex(1)));
  while (++at <= count) {
    lua_pushinteger(L, at);
    lua_replace(L, lua_upvalueindex(2));
    lua_rawgeti(L, lua_upvalueindex(1), at);
    lua_pushvalue(L, -1);
    if (lua_rawget(L, 1) != LUA_TNIL) return 2;  // it may have been taken out on the way
    lua_pop(L, 2);
  }
  lua_pushnil(L);
  return 1;
}

/// After a __pairs of the script that has waited: its three results are on top.
int end_own_pairs(lua_State*, int, lua_KContext) { return 3; }

/// In plain Lua the order follows hashes and addresses, so with it the order of currents, waits and
/// rows of a record would differ from run to run. Sorting costs n log n for each loop.
int ordered_pairs(lua_State* L) {
  luaL_checkany(L, 1);
  if (luaL_getmetafield(L, 1, "__pairs") != LUA_TNIL) {
    lua_pushvalue(L, 1);
    lua_callk(L, 1, 3, 0, end_own_pairs);
    return 3;
  }
  luaL_checktype(L, 1, LUA_TTABLE);
  return guarded(L, "pairs: ", [L] {
    push_sorted_keys(L, 1);
    lua_pushinteger(L, 0);
    lua_pushcclosure(L, next_of_keys, 2);
    lua_pushvalue(L, 1);
    lua_pushnil(L);
    return 3;
  });
}

/// Sorts at each call, so a walk by next() is slow; it is meant for next(t) == nil. Of a key that
/// is not in the table there is no next.
int ordered_next(lua_State* L) {
  luaL_checktype(L, 1, LUA_TTABLE);
  lua_settop(L, 2);
  guarded(L, "next: ", [L] {
    push_sorted_keys(L, 1);
    return 1;
  });
  const auto count = static_cast<lua_Integer>(lua_rawlen(L, 3));
  bool found = lua_isnil(L, 2);
  for (lua_Integer i = 1; i <= count; ++i) {
    lua_rawgeti(L, 3, i);
    if (found) {
      lua_pushvalue(L, -1);
      lua_rawget(L, 1);
      return 2;
    }
    found = lua_rawequal(L, -1, 2);
    lua_pop(L, 1);
  }
  lua_pushnil(L);
  return 1;
}

/// Without addresses, which differ from run to run.
int to_text(lua_State* L) {
  luaL_checkany(L, 1);
  return guarded(L, "tostring: ", [L] {
    const std::string text = plain_text(L, 1);
    lua_pushlstring(L, text.data(), text.size());
    return 1;
  });
}

/// One line of the run's output; no output where nothing listens, as when a file is only being
/// read.
int print(lua_State* L) {
  return guarded(L, "print: ", [L] {
    std::string line;
    for (int i = 1; i <= lua_gettop(L); ++i) line += (i > 1 ? "\t" : "") + plain_text(L, i);
    const HostCode host(context_of(L));
    if (const auto& show = context_of(L).print) show(line);
    return 0;
  });
}

/// Shows what `%s` would show with an address; refuses `%p`.
void prepare_format(lua_State* L) {
  const std::string format = luaL_checkstring(L, 1);
  int argument = 1;
  for (std::size_t i = 0; i + 1 < format.size(); ++i) {
    if (format[i] != '%') continue;
    ++i;
    if (format[i] == '%') continue;
    // Flags, width and precision, up to the letter of the conversion.
    while (i + 1 < format.size() && !std::isalpha(static_cast<unsigned char>(format[i]))) ++i;
    ++argument;
    if (format[i] == 'p')
      throw std::invalid_argument("%p is not available: addresses differ from run to run");
    const int type = argument <= lua_gettop(L) ? lua_type(L, argument) : LUA_TNIL;
    if (format[i] != 's' || type == LUA_TSTRING || type == LUA_TNUMBER || type == LUA_TNIL)
      continue;
    const std::string text = plain_text(L, argument);
    lua_pushlstring(L, text.data(), text.size());
    lua_replace(L, argument);
  }
}

/// Lua's own string.format sees this file's function as its caller: it knows no line, and no name
/// for itself. Both are the script's, which called `format`.
int raise_from_script(lua_State* L) {
  if (lua_type(L, -1) != LUA_TSTRING) return lua_error(L);
  luaL_where(L, 1);
  luaL_gsub(L, lua_tostring(L, -2), "to '?'", "to 'format'");
  lua_concat(L, 2);
  return lua_error(L);
}

/// Upvalue 1 is Lua's own string.format, which gets only what has no address.
int format(lua_State* L) {
  guarded(L, "string.format: ", [L] {
    prepare_format(L);
    return 0;
  });
  lua_pushvalue(L, lua_upvalueindex(1));
  lua_insert(L, 1);
  if (lua_pcall(L, lua_gettop(L) - 1, LUA_MULTRET, 0) != LUA_OK) return raise_from_script(L);
  return lua_gettop(L);
}

}  // namespace

/// string.format is replaced in the library's table, so that ("%s"):format finds it too.
void open_order(lua_State* L) {
  const luaL_Reg own[] = {{"pairs", ordered_pairs},
                          {"next", ordered_next},
                          {"tostring", to_text},
                          {"print", print},
                          {nullptr, nullptr}};
  lua_pushglobaltable(L);
  luaL_setfuncs(L, own, 0);
  lua_getfield(L, -1, LUA_STRLIBNAME);
  lua_getfield(L, -1, "format");
  lua_pushcclosure(L, format, 1);
  lua_setfield(L, -2, "format");
  lua_pop(L, 2);
}

}  // namespace vitreo::lua
