// Bindings as tables: one C++ function and one row that says its signature. Argument checks,
// help(), the editor stubs and the reference are made from the rows.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <lua.hpp>

#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace vitreo::lua {

struct Context;
struct Wait;

/// What an argument takes. A vector's kind follows from its unit: a position in m, a velocity in
/// m/s, a force in N, a field in T. A direction is a vector without unit that is not zero.
enum class Type {
  any,
  number,
  integer,
  flag,
  text,
  function,
  vector,
  direction,
  numbers,
  list,
  table,
  handle,
  options
};

struct Argument {
  std::string name{};
  Type type = Type::any;
  std::string unit{};  // SI, of numbers and vectors
  bool optional = false;
  double min = -std::numeric_limits<double>::infinity();  // SI, inclusive
  double max = std::numeric_limits<double>::infinity();
  std::string help{};
  std::string handle{};                // Type::handle: the class
  std::vector<Argument> options{};     // Type::options: its keys
  std::vector<std::string> choices{};  // Type::text: the allowed values; empty: any
  bool other = false;                  // choices are only offered: others may be given
};

/// A named value of a table that a call returns.
struct ResultField {
  std::string name{};
  std::string unit{};  // SI, of a number, a vector or a list of numbers; "" else
  std::string help{};
  std::vector<ResultField> fields{};  // of a table, or of each entry of a list of tables
  bool optional = false;              // may be nil
};

/// What a call returns: `type` is "", "number", "position", "list of numbers", "table", "list of
/// tables", the name of a class, or other words. Tables have fields, the rest may have a unit.
struct Returned {
  Returned() = default;
  Returned(const char* what, const char* si_unit = "") : type(what), unit(si_unit) {}
  Returned(const char* what, std::vector<ResultField> its_fields)
      : type(what), fields(std::move(its_fields)) {}
  /// The same, or nil: "outside of the vitreous".
  Returned or_nil(std::string when) const;
  /// "number in m, or nil outside of the vitreous".
  std::string text() const;

  std::string type{};
  std::string unit{};
  std::vector<ResultField> fields{};
  bool optional = false;  // may be nil
  std::string absent{};   // when it is
};

class Call;

struct Binding {
  std::string name{};
  std::vector<Argument> arguments{};
  Returned returns{};
  std::string doc{};  // one line
  int (*function)(Call&) = nullptr;
  std::string example{};     // a call that runs; empty: made from the arguments (reference.h)
  bool when_closed = false;  // may be called on a closed handle
};

/// A kind of handle. `fields` are names that may be absent on one of them (the roles of a rig).
struct Class {
  std::string name{}, doc{};
  std::vector<Binding> methods{};
  std::vector<std::string> fields{};
};

/// A checked call. Arguments count from 0, self not included; an absent optional one is has(i) ==
/// false.
class Call {
 public:
  static constexpr int kWaits = -1;  // what a function returns after wait()

  Call(lua_State* state, const Class* owner, const Binding& binding);
  lua_State* const L;
  const Binding& binding;
  Context& context() const;

  template <class T>
  T& self() const {
    return *static_cast<T*>(self_pointer().get());
  }
  /// A handle argument, or option.
  template <class T>
  T& handle(std::size_t argument) const {
    return *static_cast<T*>(pointer_at(index(argument)).get());
  }
  template <class T>
  T& handle_option(const std::string& name) const {
    push_option(name);
    auto& object = *static_cast<T*>(pointer_at(-1).get());
    lua_pop(L, 1);
    return object;
  }
  const std::shared_ptr<void>& self_pointer() const;

  int index(std::size_t argument) const { return first_ + static_cast<int>(argument); }
  bool has(std::size_t argument) const { return !lua_isnoneornil(L, index(argument)); }
  double number(std::size_t argument) const { return lua_tonumber(L, index(argument)); }
  std::string text(std::size_t argument) const;
  Eigen::Vector3d vector(std::size_t argument) const;
  Eigen::Vector3d direction(std::size_t argument) const;  // of length 1
  std::vector<double> numbers(std::size_t argument) const;

  /// Of the options table; false, or nothing, where it or the key is absent.
  bool push_option(const std::string& name) const;  // always pushes one value
  std::optional<double> number_option(const std::string& name) const;
  std::optional<std::string> text_option(const std::string& name) const;
  std::optional<Eigen::Vector3d> vector_option(const std::string& name) const;
  std::optional<std::vector<double>> numbers_option(const std::string& name) const;
  bool flag_option(const std::string& name) const { return flag_option(name, false); }
  bool flag_option(const std::string& name, bool absent) const;

  /// Waits: `return call.wait(...)`. The script goes on when the wait has ended, with what its
  /// `finish` pushed.
  int wait(Wait wait) const;
  void check_can_wait() const;  // throws std::runtime_error where Lua cannot suspend the caller
  /// Pushes the one value that the call returns. Throws std::logic_error where the unit is not that
  /// of the row.
  int result(double value, const char* unit = "") const;
  int result(const std::string& text) const;
  int result(const Eigen::Vector3d& vector, const char* unit) const;
  int result(const std::vector<double>& numbers, const char* unit = "") const;
  int flag(bool value) const;
  /// Throws std::logic_error naming call and units where this one is not that of the row.
  void check_unit(const char* unit) const;

 private:
  const std::shared_ptr<void>& pointer_at(int at) const;
  const Class* owner_;
  int first_;
};

/// Throws std::invalid_argument naming the argument and what is wanted.
void check_arguments(Call& call);
/// "a number in m", "a position {x, y, z} in m", "a velocity {x, y, z} in m/s": for help and
/// errors.
std::string wanted(const Argument& argument);
/// "servo:go_to(position, {speed, within})".
std::string signature(const Class* owner, const Binding& binding);
/// "servo:go_to", or "help" without a class.
std::string full_name(const Class* owner, const Binding& binding);

void push_function(lua_State* L, const Class* owner, const Binding& binding);
void open_classes(lua_State* L, const std::vector<const Class*>& classes);
void open_globals(lua_State* L, const std::vector<Binding>& functions);
/// Pushes a new handle; an empty object is a closed one. Its uservalue holds fields.
void push_handle(lua_State* L, const Class& kind, std::shared_ptr<void> object);
/// Gives the handle on top the field that is below it, and pops that: [field, handle] -> [handle].
void set_field_below(lua_State* L, const char* name);
/// The row and the class of a function that push_function made; nulls for any other value.
struct Bound {
  const Binding* row = nullptr;
  const Class* owner = nullptr;
};
Bound bound_function(lua_State* L, int index);
/// For the prompt: keeps which call gave the values that stand on top, so that their unit can be
/// shown.
void remember_results(lua_State* L, const Binding& binding, int count);
/// The class' name of a handle, or null.
const Class* handle_class(lua_State* L, int index);
/// What a handle holds; null for a closed one. `index` must be that of a handle.
void* handle_object(lua_State* L, int index);
/// Empties the handle of self: closed from here on.
void close_handle(Call& call);

}  // namespace vitreo::lua
