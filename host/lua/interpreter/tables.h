// Tables of numbers and options, pushed and read.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/lua/interpreter/binding.h"

#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace vitreo::lua {

using Field = std::pair<const char*, double>;

/// A table of them. What is not finite is left out: nil, not a NaN that travels on.
void push_fields(lua_State* L, const std::vector<Field>& fields);
void set_fields(lua_State* L, const std::vector<Field>& fields);  // into the table on top
/// Into the table on top.
void set_number(lua_State* L, const char* name, double value);
void push_numbers(lua_State* L, const std::vector<double>& numbers);

/// An options table by itself, where a call has several, or an entry of a list. Checked options
/// have the right types; of an entry, a field of another type counts as absent.
class OptionTable {
 public:
  OptionTable(lua_State* state, int index) : L_(state), index_(index) {}
  OptionTable(const Call& call, std::size_t argument) : OptionTable(call.L, call.index(argument)) {}
  std::optional<double> number(const char* name) const;
  std::optional<std::string> text(const char* name) const;
  std::optional<std::vector<double>> numbers(const char* name) const;
  std::optional<Eigen::Vector3d> vector(const char* name) const;
  bool flag(const char* name) const;

 private:
  int get(const char* name) const;  // pushes the field, or nil
  lua_State* L_;
  int index_;
};

/// The argument `options` with these keys, and those that other calls have too.
Argument options_of(std::vector<Argument> keys, std::vector<Argument> shared = {});

}  // namespace vitreo::lua
