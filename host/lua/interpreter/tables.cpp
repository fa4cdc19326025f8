// SPDX-License-Identifier: Apache-2.0
#include "host/lua/interpreter/tables.h"

#include "host/lua/interpreter/values.h"

#include <cmath>
#include <stdexcept>

namespace vitreo::lua {

void push_numbers(lua_State* L, const std::vector<double>& numbers) {
  lua_createtable(L, static_cast<int>(numbers.size()), 0);
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    lua_pushnumber(L, numbers[i]);
    lua_rawseti(L, -2, static_cast<lua_Integer>(i + 1));
  }
}

// The position is kept, since nested tables push over it.
ResultTable::ResultTable(const Call& call, const std::vector<ResultField>& fields)
    : call_(call), fields_(fields) {
  luaL_checkstack(call.L, 8, "a result is too deep");
  lua_createtable(call.L, 0, static_cast<int>(fields.size()));
  index_ = lua_gettop(call.L);
}

// A name or unit that the row does not have is a mistake of ours and not the script's, hence
// std::logic_error: a test finds it.
const ResultField& ResultTable::field(const char* name, const char* unit) const {
  for (const ResultField& one : fields_) {
    if (one.name != name) continue;
    if (one.unit != unit)
      throw std::logic_error(std::string(name) + " is pushed in '" + unit +
                             "', and the row says '" + one.unit + "'");
    return one;
  }
  throw std::logic_error(std::string(name) + " is not in the row's result");
}

// For handles and tables, which have no unit.
ResultTable& ResultTable::top(const char* name) {
  static_cast<void>(field(name, ""));
  lua_setfield(call_.L, index_, name);
  return *this;
}

// The row is checked even for what is left out, so that a wrong name does not hide behind a NaN.
ResultTable& ResultTable::number(const char* name, double value, const char* unit) {
  static_cast<void>(field(name, unit));
  if (!std::isfinite(value)) return *this;
  lua_pushnumber(call_.L, value);
  lua_setfield(call_.L, index_, name);
  return *this;
}

ResultTable& ResultTable::integer(const char* name, lua_Integer value) {
  lua_pushinteger(call_.L, value);
  return top(name);
}

ResultTable& ResultTable::flag(const char* name, bool value) {
  lua_pushboolean(call_.L, value);
  return top(name);
}

ResultTable& ResultTable::text(const char* name, const std::string& value) {
  lua_pushlstring(call_.L, value.data(), value.size());
  return top(name);
}

ResultTable& ResultTable::vector(const char* name, const Eigen::Vector3d& value, const char* unit) {
  static_cast<void>(field(name, unit));
  push_vector(call_.L, value);
  lua_setfield(call_.L, index_, name);
  return *this;
}

ResultTable& ResultTable::numbers(const char* name, const std::vector<double>& values,
                                  const char* unit) {
  static_cast<void>(field(name, unit));
  push_numbers(call_.L, values);
  lua_setfield(call_.L, index_, name);
  return *this;
}

ResultTable& ResultTable::matrix(const char* name, const Eigen::MatrixXd& value, const char* unit) {
  static_cast<void>(field(name, unit));
  lua_createtable(call_.L, static_cast<int>(value.rows()), 0);
  for (Eigen::Index row = 0; row < value.rows(); ++row) {
    const Eigen::VectorXd numbers = value.row(row);
    push_numbers(call_.L, {numbers.begin(), numbers.end()});
    lua_rawseti(call_.L, -2, static_cast<lua_Integer>(row) + 1);
  }
  lua_setfield(call_.L, index_, name);
  return *this;
}

// Of something that is no table nil, as of an option that was left out.
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

// Nothing for a list that holds something else.
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

// Absent is false.
bool OptionTable::flag(const char* name) const {
  get(name);
  const bool value = lua_toboolean(L_, -1);
  lua_pop(L_, 1);
  return value;
}

Argument number_option(const char* name, const char* unit, double min, double max,
                       const char* help) {
  return {.name = name,
          .type = Type::number,
          .unit = unit,
          .optional = true,
          .min = min,
          .max = max,
          .help = help};
}

// Those of this call first, as the reference prints them in this order.
Argument options_of(std::vector<Argument> keys, std::vector<Argument> shared) {
  for (Argument& one : shared) keys.push_back(std::move(one));
  return {.name = "options", .type = Type::options, .options = std::move(keys)};
}

void set_number(lua_State* L, const char* name, double value) {
  lua_pushnumber(L, value);
  lua_setfield(L, -2, name);
}

}  // namespace vitreo::lua
