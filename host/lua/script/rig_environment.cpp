// SPDX-License-Identifier: Apache-2.0
#include "host/lua/script/rig_environment.h"

#include "host/config/config.h"
#include "host/lua/interpreter/context.h"
#include "host/lua/interpreter/errors.h"
#include "host/lua/interpreter/state.h"
#include "host/lua/interpreter/values.h"

#include <cmath>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

namespace vitreo::lua {
namespace {

/// Steps of a pattern's matcher that one call may need at most: about a second.
constexpr double kMostSteps = 1e8;

/// Behind the closing ] of the set that begins at `at`. As Lua reads it: a ] right behind the
/// opening is a member, and % takes the next character away from its meaning.
std::size_t end_of_set(std::string_view pattern, std::size_t at) {
  ++at;
  if (at < pattern.size() && pattern[at] == '^') ++at;
  for (bool first = true; at < pattern.size() && (first || pattern[at] != ']'); first = false)
    at += pattern[at] == '%' ? 2 : 1;
  return at + 1;
}

/// How many items of the pattern may match texts of several lengths.
int repeated_items(std::string_view pattern) {
  int count = 0;
  for (std::size_t at = 0; at < pattern.size();) {
    if (pattern[at] == '%') {
      at += 2;
    } else if (pattern[at] == '[') {
      at = end_of_set(pattern, at);
    } else {
      count += std::string_view("*+-?").find(pattern[at]) != std::string_view::npos;
      ++at;
    }
  }
  return count;
}

/// Calls upvalue 1 with what is on the stack. Its own errors have no line, since its caller is this
/// C function: they get the file's. What a function of the file has thrown has one.
int call_original(lua_State* L) {
  lua_pushvalue(L, lua_upvalueindex(1));
  lua_insert(L, 1);
  if (lua_pcall(L, lua_gettop(L) - 1, LUA_MULTRET, 0) == LUA_OK) return lua_gettop(L);
  if (lua_type(L, -1) != LUA_TSTRING) return lua_error(L);
  guarded(L, "", [L] {
    const std::string place = where(L), said = lua_tostring(L, -1);
    const bool has_place = said.starts_with(place.substr(0, place.find(':') + 1));
    lua_pushstring(L, ((has_place ? "" : place) + said).c_str());
    return 0;
  });
  return lua_error(L);
}

/// Lua's own find, match, gmatch or gsub, upvalue 1, where its work has a bound.
/// Each repeated item tries up to n + 1 lengths for each try of those before it, from each of n + 1
/// places: (n + 1)^(k + 1) steps, each of which looks at the pattern once.
int bounded_match(lua_State* L) {
  std::size_t text = 0, length = 0;
  luaL_checklstring(L, 1, &text);
  const char* const pattern = luaL_checklstring(L, 2, &length);
  guarded(L, "", [&] {
    const int repeated = repeated_items({pattern, length});
    const double steps =
        std::pow(static_cast<double>(text + 1), repeated + 1) * static_cast<double>(length + 1);
    if (steps > kMostSteps)
      throw std::invalid_argument("the pattern could take too long on a text of " +
                                  std::to_string(text) + " characters");
    return 0;
  });
  return call_original(L);
}

/// Lua's own string.rep, upvalue 1. Of nothing, repeated with nothing between, it counts to n all
/// the same.
int bounded_rep(lua_State* L) {
  std::size_t text = 0, between = 0;
  luaL_checklstring(L, 1, &text);
  luaL_checkinteger(L, 2);
  luaL_optlstring(L, 3, "", &between);
  if (text + between == 0) {
    lua_pushliteral(L, "");
    return 1;
  }
  return call_original(L);
}

/// The functions of the table on top, replaced by `own` with the replaced ones as upvalues.
void wrap(lua_State* L, std::initializer_list<const char*> names, lua_CFunction own) {
  for (const char* name : names) {
    lua_getfield(L, -1, name);
    lua_pushcclosure(L, own, 1);
    lua_setfield(L, -2, name);
  }
}

void remove_fields(lua_State* L, std::initializer_list<const char*> names) {
  for (const char* name : names) {
    lua_pushnil(L);
    lua_setfield(L, -2, name);
  }
}

int require_units(lua_State* L) {
  return guarded(L, "require: ", [L] {
    const std::string name = luaL_checkstring(L, 1);
    if (name != "units")
      throw std::invalid_argument("a rig file has the module units alone, and no '" + name + "'");
    push_units(L);
    return 1;
  });
}

/// Upvalue 1: the globals of scripts, some of which a rig file has not.
int not_in_a_rig_file(lua_State* L) {
  return guarded(L, "", [L]() -> int {
    const std::string word = plain_text(L, 2);
    lua_pushvalue(L, 2);
    if (lua_rawget(L, lua_upvalueindex(1)) != LUA_TNIL)
      throw std::invalid_argument("the variable " + word +
                                  " is not defined in a rig file: it computes, without files, "
                                  "clock, chance and instruments");
    const std::string near = nearest(word, text_keys(L, 1));
    throw std::invalid_argument("the variable " + word + " is not defined" +
                                (near.empty() ? "" : "; did you mean " + near + "?"));
  });
}

}  // namespace

// The libraries' own tables are changed, not copies of them: ("x"):rep() finds the string library
// through the strings' metatable. table.move counts through a range without any element.
void push_rig_environment(lua_State* L) {
  lua_newtable(L);
  push_units(L);
  lua_setfield(L, -2, "units");
  lua_pushcfunction(L, require_units);
  lua_setfield(L, -2, "require");
  for (const char* name : {"assert", "error", "ipairs", "next", "pairs", "select", "tonumber",
                           "tostring", "type", LUA_MATHLIBNAME, LUA_STRLIBNAME, LUA_TABLIBNAME}) {
    lua_getglobal(L, name);
    lua_setfield(L, -2, name);
  }
  lua_getfield(L, -1, LUA_MATHLIBNAME);
  remove_fields(L, {"random", "randomseed"});
  lua_getfield(L, -2, LUA_TABLIBNAME);
  remove_fields(L, {"move"});
  lua_getfield(L, -3, LUA_STRLIBNAME);
  wrap(L, {"find", "match", "gmatch", "gsub"}, bounded_match);
  wrap(L, {"rep"}, bounded_rep);
  lua_pop(L, 3);
  lua_createtable(L, 0, 1);
  lua_pushglobaltable(L);
  lua_pushcclosure(L, not_in_a_rig_file, 1);
  lua_setfield(L, -2, "__index");
  lua_setmetatable(L, -2);
}

}  // namespace vitreo::lua
