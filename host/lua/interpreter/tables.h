// Tables of results and of options: results are checked against the row of their call.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/lua/interpreter/binding.h"

#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace vitreo::lua {

/// Into the table on top.
void set_number(lua_State* L, const char* name, double value);
void push_numbers(lua_State* L, const std::vector<double>& numbers);

/// The table that a call returns, or a table in it, with the fields of its row. Each setter throws
/// std::logic_error naming call and field where the row has no such field, or has it in another
/// unit.
class ResultTable {
 public:
  /// Pushes an empty table, of the row's fields.
  explicit ResultTable(const Call& call) : ResultTable(call, call.binding.returns.fields) {}

  /// What is not finite is left out: nil, not a NaN that travels on.
  ResultTable& number(const char* name, double value, const char* unit = "");
  ResultTable& integer(const char* name, lua_Integer value);
  ResultTable& flag(const char* name, bool value);
  ResultTable& text(const char* name, const std::string& value);
  ResultTable& vector(const char* name, const Eigen::Vector3d& value, const char* unit);
  ResultTable& numbers(const char* name, const std::vector<double>& values, const char* unit = "");
  /// A matrix as the list of its rows.
  ResultTable& matrix(const char* name, const Eigen::MatrixXd& value, const char* unit = "");
  /// The value on top of the stack, popped: a handle.
  ResultTable& top(const char* name);
  /// A table in this one: fill(ResultTable&).
  template <class Fill>
  ResultTable& table(const char* name, Fill fill) {
    ResultTable made(call_, field(name, "").fields);
    fill(made);
    return top(name);
  }
  /// A list of tables: fill(ResultTable&, i) for i from 0.
  template <class Fill>
  ResultTable& list(const char* name, std::size_t size, Fill fill) {
    push_list(call_, field(name, "").fields, size, fill);
    return top(name);
  }
  /// Pushes a list of tables with these fields.
  template <class Fill>
  static void push_list(const Call& call, const std::vector<ResultField>& fields, std::size_t size,
                        Fill fill) {
    lua_createtable(call.L, static_cast<int>(size), 0);
    for (std::size_t i = 0; i < size; ++i) {
      ResultTable entry(call, fields);
      fill(entry, i);
      lua_rawseti(call.L, -2, static_cast<lua_Integer>(i + 1));
    }
  }

 private:
  ResultTable(const Call& call, const std::vector<ResultField>& fields);
  const ResultField& field(const char* name, const char* unit) const;
  const Call& call_;
  const std::vector<ResultField>& fields_;
  int index_;
};

/// Pushes the list of tables that a call returns: fill(ResultTable&, i) for i from 0.
template <class Fill>
int push_result_list(const Call& call, std::size_t size, Fill fill) {
  ResultTable::push_list(call, call.binding.returns.fields, size, fill);
  return 1;
}

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

/// A number that may be left out, in an SI unit and within bounds.
Argument number_option(const char* name, const char* unit, double min, double max,
                       const char* help);
/// The argument `options` with these keys, and those that other calls have too.
Argument options_of(std::vector<Argument> keys, std::vector<Argument> shared = {});

}  // namespace vitreo::lua
