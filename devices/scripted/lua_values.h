// Quantities on a Lua stack.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/roles/instrument.h"

#include <lua.hpp>

#include <cmath>
#include <optional>
#include <string>
#include <vector>

namespace vitreo::scripted {

/// A whole number stays an integer of Lua's, so that %d takes it.
inline void push_quantity(lua_State* L, const QuantityValue& value) {
  const auto push_number = [L](double number) {
    if (number == std::floor(number) && std::abs(number) < 1e15) {
      lua_pushinteger(L, static_cast<lua_Integer>(number));
    } else {
      lua_pushnumber(L, number);
    }
  };
  if (const auto* number = std::get_if<double>(&value)) {
    push_number(*number);
  } else if (const auto* flag = std::get_if<bool>(&value)) {
    lua_pushboolean(L, *flag);
  } else if (const auto* text = std::get_if<std::string>(&value)) {
    lua_pushlstring(L, text->data(), text->size());
  } else {
    const auto& list = std::get<std::vector<double>>(value);
    lua_createtable(L, static_cast<int>(list.size()), 0);
    for (std::size_t i = 0; i < list.size(); ++i) {
      push_number(list[i]);
      lua_rawseti(L, -2, static_cast<lua_Integer>(i + 1));
    }
  }
}

/// A list of finite numbers; nothing for any other value. Leaves the stack as it is.
inline std::optional<std::vector<double>> numbers_at(lua_State* L, int index) {
  if (lua_type(L, index) != LUA_TTABLE) return std::nullopt;
  std::vector<double> list;
  const lua_Integer count = static_cast<lua_Integer>(lua_rawlen(L, index));
  if (count > 100000) return std::nullopt;
  const int at = lua_absindex(L, index);
  for (lua_Integer i = 1; i <= count; ++i) {
    const bool good = lua_rawgeti(L, at, i) == LUA_TNUMBER && std::isfinite(lua_tonumber(L, -1));
    list.push_back(good ? lua_tonumber(L, -1) : 0);
    lua_pop(L, 1);
    if (!good) return std::nullopt;
  }
  return list;
}

/// A number, flag, text or list of numbers; nothing for any other value, or one that is not finite.
inline std::optional<QuantityValue> quantity_at(lua_State* L, int index) {
  switch (lua_type(L, index)) {
    case LUA_TNUMBER:
      if (!std::isfinite(lua_tonumber(L, index))) return std::nullopt;
      return QuantityValue(static_cast<double>(lua_tonumber(L, index)));
    case LUA_TBOOLEAN:
      return QuantityValue(lua_toboolean(L, index) != 0);
    case LUA_TSTRING:
      return QuantityValue(std::string(lua_tostring(L, index), lua_rawlen(L, index)));
    case LUA_TTABLE:
      if (auto list = numbers_at(L, index)) return QuantityValue(std::move(*list));
      return std::nullopt;
    default:
      return std::nullopt;
  }
}

}  // namespace vitreo::scripted
