// Conversions of Lua values: to text for people, to vectors and lists for C++.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <lua.hpp>

#include <map>
#include <optional>
#include <string>
#include <vector>

namespace vitreo::lua {

/// A vector: a table {x, y, z} with arithmetic.
void push_vector(lua_State* L, const Eigen::Vector3d& vector);
/// Three finite numbers in a table, or nothing.
std::optional<Eigen::Vector3d> to_vector(lua_State* L, int index);
/// A list of numbers, or nothing.
std::optional<std::vector<double>> to_numbers(lua_State* L, int index);
void open_vectors(lua_State* L);  // the global vector(x, y, z)

/// tostring() without addresses: "table", "function".
std::string plain_text(lua_State* L, int index);
/// A number, or a list of a few, in a display unit (`unit`: SI); a list has one for all: "{1.00,
/// 0.98} mm". Nothing where it is neither.
std::optional<std::string> in_peoples_unit(lua_State* L, int index, const std::string& unit);
/// Names in a table, and the SI units of what is under them; "": of all other names.
using FieldUnits = std::map<std::string, std::string>;
/// For the prompt: tables with their contents, down to `depth`; numbers, and lists of them, under
/// the names of `units` in the units of people.
std::string pretty(lua_State* L, int index, int depth = 3, const FieldUnits& units = {});
/// The same of what is under `name` in a table.
std::string pretty_field(lua_State* L, const std::string& name, int index, int depth,
                         const FieldUnits& units);
/// "a string", "a number", "nothing", "a servo": for errors.
std::string kind_of(lua_State* L, int index);

/// Pushes the keys of the table at `index` as a list in their order: numbers, strings, booleans.
/// Keys of another kind have no order that holds from run to run: std::invalid_argument.
void push_sorted_keys(lua_State* L, int index);
/// The string keys of the table, sorted.
std::vector<std::string> text_keys(lua_State* L, int index);

/// The string under `name` in the table, "" where it is absent and not needed. Errors begin with
/// `where`.
std::string text_field(lua_State* L, int index, const char* name, const std::string& where,
                       bool needed);
/// Throws std::invalid_argument, with the nearest known one, for a string key that is not known.
void refuse_unknown(lua_State* L, int index, const std::string& where,
                    const std::vector<std::string>& known);

}  // namespace vitreo::lua
