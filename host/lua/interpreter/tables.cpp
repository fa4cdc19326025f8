// SPDX-License-Identifier: Apache-2.0
#include "host/lua/interpreter/tables.h"

#include "host/lua/interpreter/values.h"

#include <cmath>

namespace vitreo::lua {

void set_fields(lua_State* L, const std::vector<Field>& fields) {
  for (const auto& [name, value] : fields) {
    if (!std::isfinite(value)) continue;
    lua_pushnumber(L, value);
    lua_setfield(L, -2, name);
  }
}

void push_fields(lua_State* L, const std::vector<Field>& fields) {
  lua_createtable(L, 0, static_cast<int>(fields.size()));
  set_fields(L, fields);
}

void push_numbers(lua_State* L, const std::vector<double>& numbers) {
  lua_createtable(L, static_cast<int>(numbers.size()), 0);
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    lua_pushnumber(L, numbers[i]);
    lua_rawseti(L, -2, static_cast<lua_Integer>(i + 1));
  }
}

int OptionTable::get(const char* name) const {
  if (lua_istable(L_, index_)) return lua_getfield(L_, index_, name);
  lua_pushnil(L_);
  return LUA_TNIL;
}

std::optional<double> OptionTable::number(const char* name) const {
  std::optional<double> value;
  if (get(name) == LUA_TNUMBER) value = lua_tonumber(L_, -1);
  lua_pop(L_, 1);
  return value;
}

std::optional<std::string> OptionTable::text(const char* name) const {
  std::optional<std::string> value;
  if (get(name) == LUA_TSTRING) value = lua_tostring(L_, -1);
  lua_pop(L_, 1);
  return value;
}

std::optional<std::vector<double>> OptionTable::numbers(const char* name) const {
  get(name);
  auto value = to_numbers(L_, -1);
  lua_pop(L_, 1);
  return value;
}

std::optional<Eigen::Vector3d> OptionTable::vector(const char* name) const {
  get(name);
  auto value = to_vector(L_, -1);
  lua_pop(L_, 1);
  return value;
}

bool OptionTable::flag(const char* name) const {
  get(name);
  const bool value = lua_toboolean(L_, -1);
  lua_pop(L_, 1);
  return value;
}

Argument options_of(std::vector<Argument> keys, std::vector<Argument> shared) {
  for (Argument& one : shared) keys.push_back(std::move(one));
  return {.name = "options", .type = Type::options, .options = std::move(keys)};
}

void set_number(lua_State* L, const char* name, double value) {
  lua_pushnumber(L, value);
  lua_setfield(L, -2, name);
}

}  // namespace vitreo::lua
