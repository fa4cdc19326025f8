// SPDX-License-Identifier: Apache-2.0
#include "host/lua/interpreter/values.h"

#include "host/config/config.h"
#include "host/text/columns.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace vitreo::lua {
namespace {

/// What __tostring says, as text, or nothing where there is none. Its errors pass.
std::optional<std::string> own_text(lua_State* L, int index) {
  if (luaL_getmetafield(L, index, "__tostring") == LUA_TNIL) return std::nullopt;
  lua_pushvalue(L, index);
  lua_call(L, 1, 1);
  const char* text = lua_tostring(L, -1);
  std::string result = text ? text : "?";
  lua_pop(L, 1);
  return result;
}

enum class Rank { number, text, flag };

Rank rank(lua_State* L, int index) {
  switch (lua_type(L, index)) {
    case LUA_TNUMBER:
      return Rank::number;
    case LUA_TSTRING:
      return Rank::text;
    case LUA_TBOOLEAN:
      return Rank::flag;
    default:
      throw std::invalid_argument(
          "a table that is walked has a key that is a " + kind_of(L, index).substr(2) +
          ": such keys have no order that holds from run to run; use numbers or strings");
  }
}

bool key_before(lua_State* L, int a, int b) {
  const Rank rank_a = rank(L, a), rank_b = rank(L, b);
  if (rank_a != rank_b) return rank_a < rank_b;
  if (rank_a == Rank::flag) return !lua_toboolean(L, a) && lua_toboolean(L, b);
  if (rank_a == Rank::number) return lua_compare(L, a, b, LUA_OPLT);
  std::size_t size_a = 0, size_b = 0;  // bytes, not strcoll: Lua's own < depends on the locale
  const char* const text_a = lua_tolstring(L, a, &size_a);
  const char* const text_b = lua_tolstring(L, b, &size_b);
  return std::string_view(text_a, size_a) < std::string_view(text_b, size_b);
}

std::string pretty_table(lua_State* L, int index, int depth, const FieldUnits& units) {
  if (depth <= 0) return "{...}";
  constexpr int kShown = 40;
  std::string text = "{";
  push_sorted_keys(L, index);
  const int keys = lua_gettop(L);
  const auto count = static_cast<lua_Integer>(lua_rawlen(L, keys));
  for (lua_Integer i = 1, list = 1; i <= count; ++i) {
    if (i > kShown) {
      text += ", ...";
      break;
    }
    lua_rawgeti(L, keys, i);
    const bool next_of_list = lua_isinteger(L, -1) && lua_tointeger(L, -1) == list;
    const std::string name = lua_type(L, -1) == LUA_TSTRING ? plain_text(L, lua_gettop(L)) : "";
    text += i > 1 ? ", " : "";
    if (next_of_list)
      ++list;
    else
      text += lua_type(L, -1) == LUA_TSTRING ? name + " = "
                                             : "[" + plain_text(L, lua_gettop(L)) + "] = ";
    lua_rawget(L, index);
    text += pretty_field(L, name, lua_gettop(L), depth - 1, units);
    lua_pop(L, 1);
  }
  lua_settop(L, keys - 1);
  return text + "}";
}

}  // namespace

std::optional<std::string> in_peoples_unit(lua_State* L, int index, const std::string& unit) {
  if (lua_type(L, index) == LUA_TNUMBER) return format_quantity(lua_tonumber(L, index), unit, 6);
  constexpr std::size_t kLongest = 16;
  const auto numbers = to_numbers(L, index);
  if (!numbers || numbers->empty() || numbers->size() > kLongest) return std::nullopt;
  const ShownColumn column = show_column(*numbers, unit, 4);
  std::string text;
  for (const std::string& number : column.numbers) text += (text.empty() ? "{" : ", ") + number;
  return with_unit({text + "}", column.unit});
}

std::string plain_text(lua_State* L, int index) {
  index = lua_absindex(L, index);
  if (const auto own = own_text(L, index)) return *own;
  switch (lua_type(L, index)) {
    case LUA_TNUMBER: {
      lua_pushvalue(L, index);
      std::string text = lua_tostring(L, -1);
      lua_pop(L, 1);
      return text;
    }
    case LUA_TSTRING: {
      std::size_t size = 0;
      const char* text = lua_tolstring(L, index, &size);
      return std::string(text, size);
    }
    case LUA_TBOOLEAN:
      return lua_toboolean(L, index) ? "true" : "false";
    default:
      return lua_typename(L, lua_type(L, index));  // an address would differ from run to run
  }
}

std::string pretty(lua_State* L, int index, int depth, const FieldUnits& units) {
  index = lua_absindex(L, index);
  luaL_checkstack(L, 10, "a table that is shown is too deep");
  if (lua_type(L, index) == LUA_TSTRING) return '"' + plain_text(L, index) + '"';
  if (lua_istable(L, index) && luaL_getmetafield(L, index, "__tostring") == LUA_TNIL)
    return pretty_table(L, index, depth, units);
  if (lua_istable(L, index)) lua_pop(L, 1);
  return plain_text(L, index);
}

std::string pretty_field(lua_State* L, const std::string& name, int index, int depth,
                         const FieldUnits& units) {
  const auto named = units.find(name), unit = named == units.end() ? units.find("") : named;
  const auto text = unit == units.end() ? std::nullopt : in_peoples_unit(L, index, unit->second);
  return text ? *text : pretty(L, index, depth, units);
}

std::string kind_of(lua_State* L, int index) {
  // A handle's metatable bears its class' name.
  if (lua_type(L, index) == LUA_TUSERDATA && luaL_getmetafield(L, index, "__name") == LUA_TSTRING) {
    const std::string name = lua_tostring(L, -1);
    lua_pop(L, 1);
    return "a " + name;
  }
  switch (lua_type(L, index)) {
    case LUA_TNONE:
    case LUA_TNIL:
      return "nothing";
    case LUA_TBOOLEAN:
      return lua_toboolean(L, index) ? "true" : "false";
    default:
      return std::string("a ") + lua_typename(L, lua_type(L, index));
  }
}

std::optional<Eigen::Vector3d> to_vector(lua_State* L, int index) {
  const auto numbers = to_numbers(L, index);
  if (!numbers || numbers->size() != 3) return std::nullopt;
  return Eigen::Vector3d((*numbers)[0], (*numbers)[1], (*numbers)[2]);
}

std::optional<std::vector<double>> to_numbers(lua_State* L, int index) {
  if (!lua_istable(L, index)) return std::nullopt;
  index = lua_absindex(L, index);
  std::vector<double> numbers(lua_rawlen(L, index));
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    const bool number = lua_rawgeti(L, index, static_cast<lua_Integer>(i + 1)) == LUA_TNUMBER;
    numbers[i] = lua_tonumber(L, -1);
    lua_pop(L, 1);
    if (!number) return std::nullopt;
  }
  return numbers;
}

void push_sorted_keys(lua_State* L, int index) {
  index = lua_absindex(L, index);
  luaL_checkstack(L, 8, "too much on the stack");
  lua_newtable(L);
  const int keys = lua_gettop(L);
  lua_Integer count = 0;
  for (lua_pushnil(L); lua_next(L, index) != 0;) {
    lua_pop(L, 1);
    rank(L, -1);  // refuses what has no order
    lua_pushvalue(L, -1);
    lua_rawseti(L, keys, ++count);
  }
  std::vector<lua_Integer> order(static_cast<std::size_t>(count));
  for (lua_Integer i = 0; i < count; ++i) order[static_cast<std::size_t>(i)] = i + 1;
  std::sort(order.begin(), order.end(), [&](lua_Integer a, lua_Integer b) {
    lua_rawgeti(L, keys, a);
    lua_rawgeti(L, keys, b);
    const bool before = key_before(L, -2, -1);
    lua_pop(L, 2);
    return before;
  });
  lua_createtable(L, static_cast<int>(count), 0);
  for (lua_Integer i = 0; i < count; ++i) {
    lua_rawgeti(L, keys, order[static_cast<std::size_t>(i)]);
    lua_rawseti(L, -2, i + 1);
  }
  lua_remove(L, keys);
}

std::vector<std::string> text_keys(lua_State* L, int index) {
  index = lua_absindex(L, index);
  std::vector<std::string> keys;
  for (lua_pushnil(L); lua_next(L, index) != 0; lua_pop(L, 1))
    if (lua_type(L, -2) == LUA_TSTRING) keys.emplace_back(lua_tostring(L, -2));
  std::sort(keys.begin(), keys.end());
  return keys;
}

std::string text_field(lua_State* L, int index, const char* name, const std::string& where,
                       bool needed) {
  lua_getfield(L, index, name);
  if (lua_isnil(L, -1) ? needed : lua_type(L, -1) != LUA_TSTRING)
    throw std::invalid_argument(where + name + ": wants a string, got " + kind_of(L, -1));
  const std::string text = lua_isnil(L, -1) ? "" : lua_tostring(L, -1);
  lua_pop(L, 1);
  return text;
}

void refuse_unknown(lua_State* L, int index, const std::string& where,
                    const std::vector<std::string>& known) {
  for (const std::string& key : text_keys(L, index)) {
    if (std::find(known.begin(), known.end(), key) != known.end()) continue;
    const std::string near = nearest(key, known);
    throw std::invalid_argument(where + key + " is not known" +
                                (near.empty() ? "" : "; did you mean " + near + "?"));
  }
}

}  // namespace vitreo::lua
