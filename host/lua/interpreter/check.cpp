// Check of the arguments against their row, before any binding sees them.
// SPDX-License-Identifier: Apache-2.0
#include "host/config/config.h"
#include "host/lua/interpreter/binding.h"
#include "host/lua/interpreter/values.h"
#include "host/text/columns.h"
#include "host/text/units.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace vitreo::lua {
namespace {

/// By the first letter, which is right for all the nouns of this interface.
std::string a_or_an(const std::string& noun) {
  return (std::string("aeiou").find(noun[0]) != std::string::npos ? "an " : "a ") + noun;
}

/// For the end of a sentence; empty without a unit.
std::string in_unit(const Argument& argument) {
  return argument.unit.empty() ? "" : " in " + argument.unit;
}

/// "a, b or c".
std::string one_of(const std::vector<std::string>& words) {
  std::string text;
  for (std::size_t i = 0; i < words.size(); ++i)
    text += (i == 0 ? "" : i + 1 == words.size() ? " or " : ", ") + words[i];
  return text;
}

/// Bounds are SI in the rows; here they are told in the unit that people use.
std::string range_text(const Argument& argument) {
  if (std::isinf(argument.max)) return "at least " + format_quantity(argument.min, argument.unit);
  if (std::isinf(argument.min)) return "at most " + format_quantity(argument.max, argument.unit);
  return format_range(argument.min, argument.max, argument.unit);
}

/// The argument's name, what is wanted, what came: enough to mend the call without the reference.
[[noreturn]] void refuse(lua_State* L, const Argument& argument, int index) {
  throw std::invalid_argument(argument.name + ": wants " + wanted(argument) + ", got " +
                              kind_of(L, index));
}

/// Lua would take the text "5" for a number too; here it is refused, as it is mostly a mistake.
void check_number(lua_State* L, const Argument& argument, int index) {
  if (lua_type(L, index) != LUA_TNUMBER) refuse(L, argument, index);
  const double value = lua_tonumber(L, index);
  // 1e15: below it a double holds each whole number exactly.
  if (argument.type == Type::integer && !(std::floor(value) == value && std::abs(value) < 1e15))
    throw std::invalid_argument(argument.name + ": wants a whole number, got " +
                                plain_text(L, index));
  // Before the bounds, since a NaN passes every comparison with them.
  if (!std::isfinite(value))
    throw std::invalid_argument(argument.name + ": wants " + wanted(argument) + ", got " +
                                plain_text(L, index));
  if (value < argument.min || value > argument.max)
    throw std::invalid_argument(argument.name + ": wants " + range_text(argument) + ", got " +
                                format_quantity(value, argument.unit));
}

/// The first thing in a list that is no number, by its place.
/// Throws in any case: where each entry is a number, the list itself is at fault, as by its length.
void refuse_list(lua_State* L, const Argument& argument, int index) {
  const auto count = lua_istable(L, index) ? static_cast<lua_Integer>(lua_rawlen(L, index)) : 0;
  for (lua_Integer i = 1; i <= count; ++i)
    if (lua_rawgeti(L, index, i) != LUA_TNUMBER)
      throw std::invalid_argument(argument.name + "[" + std::to_string(i) + "]: wants a number" +
                                  in_unit(argument) + ", got " + kind_of(L, -1));
    else
      lua_pop(L, 1);
  refuse(L, argument, index);
}

/// A vector has exactly three entries; a direction may have any length but zero.
void check_numbers(lua_State* L, const Argument& argument, int index) {
  const auto numbers = to_numbers(L, index);
  if (!numbers) refuse_list(L, argument, index);
  const bool vector = argument.type == Type::vector || argument.type == Type::direction;
  if (vector && numbers->size() != 3) refuse(L, argument, index);
  for (const double number : *numbers)
    if (!std::isfinite(number))
      throw std::invalid_argument(argument.name + ": holds a number that is not finite");
  const auto zero = [](double number) { return number == 0; };
  if (argument.type == Type::direction && std::all_of(numbers->begin(), numbers->end(), zero))
    throw std::invalid_argument(argument.name + ": wants a direction, got {0, 0, 0}");
}

/// What people call a vector in that SI unit.
const char* kind_of_vector(const std::string& unit) {
  if (unit == "m") return "position";
  if (unit == "m/s") return "velocity";
  if (unit == "N") return "force";
  if (unit == "T") return "field";
  return "vector";
}

/// Only what Lua's own types decide; true for those that have a check of their own below.
bool lua_type_fits(lua_State* L, const Argument& argument, int index) {
  switch (argument.type) {
    case Type::flag:
      return lua_isboolean(L, index);
    case Type::text:
      return lua_type(L, index) == LUA_TSTRING;
    case Type::function:
      return lua_isfunction(L, index);
    case Type::list:
    case Type::table:
    case Type::options:
      return lua_istable(L, index);
    default:
      return true;
  }
}

void check_choice(lua_State* L, const Argument& argument, int index);

/// A handle with choices may be given by one of these words instead.
/// To Lua all handles are userdata, so the class is asked.
void check_handle(lua_State* L, const Argument& argument, int index) {
  if (!argument.choices.empty() && lua_type(L, index) == LUA_TSTRING)
    return check_choice(L, argument, index);
  const Class* kind = handle_class(L, index);
  if (!kind || kind->name != argument.handle) refuse(L, argument, index);
}

/// With the nearest choice, as most words that are not known are misspelled.
void check_choice(lua_State* L, const Argument& argument, int index) {
  const std::string word = plain_text(L, index);
  if (std::find(argument.choices.begin(), argument.choices.end(), word) != argument.choices.end())
    return;
  const std::string near = nearest(word, argument.choices);
  throw std::invalid_argument(argument.name + ": wants " + wanted(argument) + ", got '" + word +
                              "'" + (near.empty() ? "" : "; did you mean " + near + "?"));
}

void check_one(lua_State* L, const Argument& argument, int index);

void check_options(lua_State* L, const Argument& argument, int index);

/// Two tables of one call may have keys of one name: an error says in which.
void check_table_among_options(lua_State* L, const Argument& option, int index) {
  try {
    check_options(L, option, index);
  } catch (const std::invalid_argument& error) {
    throw std::invalid_argument(option.name + ": " + error.what());
  }
}

/// Unknown keys first: a misspelled option would else be left out without a word. Sorted, so that
/// the same call fails with the same message in each run.
void check_options(lua_State* L, const Argument& argument, int index) {
  std::vector<std::string> known;
  for (const Argument& option : argument.options) known.push_back(option.name);
  push_sorted_keys(L, index);
  const auto count = static_cast<lua_Integer>(lua_rawlen(L, -1));
  for (lua_Integer i = 1; i <= count; ++i) {
    lua_rawgeti(L, -1, i);
    const std::string key = plain_text(L, -1);
    lua_pop(L, 1);
    if (std::find(known.begin(), known.end(), key) != known.end()) continue;
    const std::string near = nearest(key, known);
    throw std::invalid_argument(key + " is not known" +
                                (near.empty() ? "" : "; did you mean " + near + "?"));
  }
  lua_pop(L, 1);
  // An option that is absent is still checked when it is needed: then it is reported as missing.
  for (const Argument& option : argument.options) {
    lua_getfield(L, index, option.name.c_str());
    if (option.type == Type::options && lua_istable(L, -1))
      check_table_among_options(L, option, lua_gettop(L));
    else if (!lua_isnil(L, -1) || !option.optional)
      check_one(L, option, lua_gettop(L));
    lua_pop(L, 1);
  }
}

/// `index` is absolute, as the checks push. An option may have options of its own, hence the room
/// on the stack.
void check_one(lua_State* L, const Argument& argument, int index) {
  luaL_checkstack(L, 10, "too many arguments");
  if (lua_isnoneornil(L, index))
    throw std::invalid_argument(argument.name + ": is missing; wants " + wanted(argument));
  if (!lua_type_fits(L, argument, index)) refuse(L, argument, index);
  if (argument.type == Type::number || argument.type == Type::integer)
    check_number(L, argument, index);
  if (argument.type == Type::vector || argument.type == Type::direction ||
      argument.type == Type::numbers)
    check_numbers(L, argument, index);
  if (argument.type == Type::handle) check_handle(L, argument, index);
  if (argument.type == Type::options) check_options(L, argument, index);
  if (argument.type == Type::text && !argument.choices.empty() && !argument.other)
    check_choice(L, argument, index);
}

/// Such a call may leave its options table out.
bool all_optional(const Argument& argument) {
  for (const Argument& option : argument.options)
    if (!option.optional) return false;
  return true;
}

/// As signatures show it: [name] may be left out, {a, b} is a table with these keys.
std::string shown(const Argument& argument) {
  if (argument.type != Type::options)
    return argument.optional ? "[" + argument.name + "]" : argument.name;
  std::string text = "{";
  for (const Argument& option : argument.options)
    text += (text.size() > 1 ? ", " : "") + option.name;
  return text + "}";
}

}  // namespace

/// For messages and for the reference: one wording in both.
std::string wanted(const Argument& argument) {
  switch (argument.type) {
    case Type::any:
      return "a value";
    case Type::number:
      return "a number" + in_unit(argument);
    case Type::integer:
      return "a whole number";
    case Type::flag:
      return "true or false";
    case Type::text:
      return argument.choices.empty() || argument.other ? "a string" : one_of(argument.choices);
    case Type::function:
      return "a function";
    case Type::vector:
      return std::string("a ") + kind_of_vector(argument.unit) + " {x, y, z}" + in_unit(argument);
    case Type::direction:
      return "a direction {x, y, z}";
    case Type::numbers:
      return "a list of numbers" + in_unit(argument);
    case Type::list:
      return "a list";
    case Type::table:
      return "a table";
    case Type::handle:
      return a_or_an(argument.handle) +
             (argument.choices.empty() ? "" : ", or " + one_of(argument.choices));
    case Type::options:
      return "options " + shown(argument);
  }
  return "a value";
}

/// Before the binding's own code, so that it may take what its row says without a test of its own.
/// A last row named "..." takes any number of arguments, unchecked.
void check_arguments(Call& call) {
  const std::vector<Argument>& rows = call.binding.arguments;
  const int given = lua_gettop(call.L) - call.index(0) + 1;
  if (given > static_cast<int>(rows.size()) && !(rows.size() && rows.back().name == "...")) {
    std::string list;
    for (const Argument& row : rows) list += (list.empty() ? "" : ", ") + shown(row);
    throw std::invalid_argument("takes (" + list + "), got " + std::to_string(given) +
                                " arguments");
  }
  for (std::size_t i = 0; i < rows.size(); ++i) {
    if (rows[i].name == "...") break;
    if (!call.has(i) &&
        (rows[i].optional || (rows[i].type == Type::options && all_optional(rows[i]))))
      continue;
    check_one(call.L, rows[i], call.index(i));
  }
}

/// As it is called in a script: class:method, or the function's own path.
std::string full_name(const Class* owner, const Binding& binding) {
  return owner ? owner->name + ":" + binding.name : binding.name;
}

/// For the message of a wrong call, the help and the reference.
std::string signature(const Class* owner, const Binding& binding) {
  std::string text = full_name(owner, binding) + "(";
  for (std::size_t i = 0; i < binding.arguments.size(); ++i)
    text += (i ? ", " : "") + shown(binding.arguments[i]);
  return text + ")" + (binding.returns.type.empty() ? "" : " -> " + binding.returns.text());
}

/// On a copy, as rows share the definitions of their results.
Returned Returned::or_nil(std::string when) const {
  Returned made = *this;
  made.optional = true;
  made.absent = std::move(when);
  return made;
}

/// As the reference prints it: type, unit, and when it is nil.
std::string Returned::text() const {
  return type + (unit.empty() ? "" : " in " + unit) + (optional ? ", or nil" : "") +
         (absent.empty() ? "" : " " + absent);
}

}  // namespace vitreo::lua
