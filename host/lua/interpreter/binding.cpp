// SPDX-License-Identifier: Apache-2.0
#include "host/lua/interpreter/binding.h"

#include "host/config/config.h"
#include "host/lua/interpreter/context.h"
#include "host/lua/interpreter/errors.h"
#include "host/lua/interpreter/scheduler.h"
#include "host/lua/interpreter/stop.h"
#include "host/lua/interpreter/turn.h"
#include "host/lua/interpreter/values.h"

#include <cmath>
#include <stdexcept>
#include <utility>

namespace vitreo::lua {
namespace {

struct Handle {
  std::shared_ptr<void> object;
};

/// The class stands in the metatable under a key that no script can make.
const char kClassKey = 0;

Handle& handle_at(lua_State* L, int index) {
  return *static_cast<Handle*>(lua_touserdata(L, index));
}

/// What dies here may be a servo loop, whose end is waited for on the clock.
int collect_handle(lua_State* L) {
  const HostCode host(context_of(L));
  handle_at(L, 1).~Handle();
  return 0;
}

int handle_text(lua_State* L) {
  const std::string name = handle_class(L, 1)->name;
  lua_pushstring(L, (handle_at(L, 1).object ? name : "closed " + name).c_str());
  return 1;
}

std::string unknown_member(lua_State* L, const Class& kind) {
  const std::string word = lua_type(L, 2) == LUA_TSTRING ? lua_tostring(L, 2) : kind_of(L, 2);
  std::vector<std::string> known = kind.fields;
  for (const Binding& method : kind.methods) known.push_back(method.name);
  const std::string near = nearest(word, known);
  return kind.name + " has no " + word + (near.empty() ? "" : "; did you mean " + near + "?");
}

/// Methods first (upvalue 1), then the handle's own fields, then the names that may be absent.
int handle_index(lua_State* L) {
  lua_pushvalue(L, 2);
  if (lua_rawget(L, lua_upvalueindex(1)) != LUA_TNIL) return 1;
  if (lua_getiuservalue(L, 1, 1) == LUA_TTABLE) {
    lua_pushvalue(L, 2);
    if (lua_rawget(L, -2) != LUA_TNIL) return 1;
  }
  const Class& kind = *handle_class(L, 1);
  return guarded(L, "", [&]() -> int {
    if (lua_type(L, 2) == LUA_TSTRING)
      for (const std::string& field : kind.fields)
        if (field == lua_tostring(L, 2)) return 0;
    throw std::invalid_argument(unknown_member(L, kind));
  });
}

int handle_write(lua_State* L) {
  return guarded(L, "", [&]() -> int {
    throw std::invalid_argument("nothing can be set on a " + handle_class(L, 1)->name);
  });
}

void check_self(lua_State* L, const Class& owner, const Binding& binding) {
  const Class* const kind = handle_class(L, 1);
  if (kind != nullptr && kind != &owner && kind->name == owner.name)
    throw std::invalid_argument("is of " + owner.name + " as it was before a reload");
  if (kind != &owner)
    throw std::invalid_argument("is called with a colon, on a " + owner.name + ": " +
                                signature(&owner, binding));
  if (!binding.when_closed && !handle_at(L, 1).object)
    throw std::invalid_argument("the " + owner.name + " is closed");
}

/// A call that waited goes on here, with the same upvalues, after its task was resumed.
int continue_wait(lua_State* L, int, lua_KContext) {
  const auto& binding = *static_cast<const Binding*>(lua_touserdata(L, lua_upvalueindex(1)));
  const auto* owner = static_cast<const Class*>(lua_touserdata(L, lua_upvalueindex(2)));
  const int results = guarded(L, full_name(owner, binding) + ": ", [&] {
    const HostCode host(context_of(L));
    LuaTask& task = *context_of(L).scheduler->current();
    if (!task.wait) throw std::logic_error("this coroutine waits on behalf of another task");
    const auto wait = std::move(task.wait);
    if (std::exchange(task.stop, false)) throw Stopped();
    if (task.error) std::rethrow_exception(std::exchange(task.error, nullptr));
    Call call(L, owner, binding);
    return wait->finish(call, task.in_time);
  });
  if (results != Call::kWaits) return remember_results(L, binding, results), results;
  return lua_yieldk(L, 0, 0, continue_wait);
}

/// What Lua calls: upvalue 1 is the row, upvalue 2 its class (null without).
int invoke(lua_State* L) {
  const auto& binding = *static_cast<const Binding*>(lua_touserdata(L, lua_upvalueindex(1)));
  const auto* owner = static_cast<const Class*>(lua_touserdata(L, lua_upvalueindex(2)));
  const int results = guarded(L, full_name(owner, binding) + ": ", [&]() -> int {
    const HostCode host(context_of(L));
    if (context_of(L).interrupted) {
      take_interrupt(context_of(L));
      throw Stopped();
    }
    if (owner) check_self(L, *owner, binding);
    Call call(L, owner, binding);
    check_arguments(call);
    return binding.function(call);
  });
  if (results != Call::kWaits) return remember_results(L, binding, results), results;
  return lua_yieldk(L, 0, 0, continue_wait);
}

void push_methods(lua_State* L, const Class& kind) {
  lua_createtable(L, 0, static_cast<int>(kind.methods.size()));
  for (const Binding& method : kind.methods) {
    push_function(L, &kind, method);
    lua_setfield(L, -2, method.name.c_str());
  }
}

int close_by_method(lua_State* L) {  // __close gets the error as well: drop it
  lua_settop(L, 1);
  lua_pushvalue(L, lua_upvalueindex(1));
  lua_insert(L, 1);
  lua_callk(L, 1, 0, 0, [](lua_State*, int, lua_KContext) { return 0; });
  return 0;
}

void open_class(lua_State* L, const Class& kind) {
  luaL_newmetatable(L, kind.name.c_str());
  lua_pushlightuserdata(L, const_cast<Class*>(&kind));
  lua_rawsetp(L, -2, &kClassKey);
  const luaL_Reg basics[] = {{"__gc", collect_handle},
                             {"__tostring", handle_text},
                             {"__newindex", handle_write},
                             {nullptr, nullptr}};
  luaL_setfuncs(L, basics, 0);
  lua_pushstring(L, kind.name.c_str());
  lua_setfield(L, -2, "__metatable");
  push_methods(L, kind);
  if (lua_getfield(L, -1, "close") != LUA_TNIL) {
    lua_pushcclosure(L, close_by_method, 1);
    lua_setfield(L, -3, "__close");
  } else {
    lua_pop(L, 1);
  }
  lua_pushcclosure(L, handle_index, 1);
  lua_setfield(L, -2, "__index");
  lua_pop(L, 1);
}

}  // namespace

Call::Call(lua_State* state, const Class* owner, const Binding& row)
    : L(state), binding(row), owner_(owner), first_(owner ? 2 : 1) {}

Context& Call::context() const { return context_of(L); }
const std::shared_ptr<void>& Call::self_pointer() const { return pointer_at(1); }
const std::shared_ptr<void>& Call::pointer_at(int at) const { return handle_at(L, at).object; }

std::string Call::text(std::size_t argument) const { return plain_text(L, index(argument)); }
Eigen::Vector3d Call::vector(std::size_t argument) const { return *to_vector(L, index(argument)); }
Eigen::Vector3d Call::direction(std::size_t argument) const {
  return vector(argument).normalized();
}
std::vector<double> Call::numbers(std::size_t argument) const {
  return *to_numbers(L, index(argument));
}

bool Call::push_option(const std::string& name) const {
  for (std::size_t i = 0; i < binding.arguments.size(); ++i) {
    if (binding.arguments[i].type != Type::options || !has(i)) continue;
    return lua_getfield(L, index(i), name.c_str()) != LUA_TNIL;
  }
  lua_pushnil(L);
  return false;
}

std::optional<double> Call::number_option(const std::string& name) const {
  std::optional<double> value;
  if (push_option(name)) value = lua_tonumber(L, -1);
  lua_pop(L, 1);
  return value;
}

std::optional<std::string> Call::text_option(const std::string& name) const {
  std::optional<std::string> value;
  if (push_option(name)) value = lua_tostring(L, -1);
  lua_pop(L, 1);
  return value;
}

std::optional<Eigen::Vector3d> Call::vector_option(const std::string& name) const {
  std::optional<Eigen::Vector3d> value;
  if (push_option(name)) value = to_vector(L, -1);
  lua_pop(L, 1);
  return value;
}

std::optional<std::vector<double>> Call::numbers_option(const std::string& name) const {
  std::optional<std::vector<double>> value;
  if (push_option(name)) value = to_numbers(L, -1);
  lua_pop(L, 1);
  return value;
}

bool Call::flag_option(const std::string& name, bool absent) const {
  const bool given = push_option(name);
  const bool value = given ? lua_toboolean(L, -1) : absent;
  lua_pop(L, 1);
  return value;
}

void Call::check_can_wait() const {
  const Scheduler* const scheduler = context().scheduler;
  if (!scheduler || !scheduler->current())
    throw std::runtime_error("nothing can be waited for while a file is only being read");
  if (!lua_isyieldable(L))
    throw std::runtime_error(
        "cannot wait here: this is called from inside a function that Lua cannot suspend "
        "(a table.sort comparison, a string.gsub replacement, a clean-up after an error)");
  if (scheduler->current()->stop) {  // it was stopped before it had anything to wait for
    scheduler->current()->stop = false;
    throw Stopped();
  }
}

int Call::wait(Wait wait) const {
  check_can_wait();
  if (wait.what.empty()) wait.what = full_name(owner_, binding);
  context().scheduler->current()->wait = std::make_unique<Wait>(std::move(wait));
  return kWaits;
}

void Call::check_unit(const char* unit) const {
  if (binding.returns.unit != unit)
    throw std::logic_error("its result is pushed in '" + std::string(unit) +
                           "', and its row says '" + binding.returns.unit + "'");
}

int Call::result(double value, const char* unit) const {
  check_unit(unit);
  lua_pushnumber(L, value);
  return 1;
}
int Call::result(const std::string& value) const {
  lua_pushlstring(L, value.data(), value.size());
  return 1;
}
int Call::result(const Eigen::Vector3d& value, const char* unit) const {
  check_unit(unit);
  push_vector(L, value);
  return 1;
}
int Call::result(const std::vector<double>& numbers, const char* unit) const {
  check_unit(unit);
  lua_createtable(L, static_cast<int>(numbers.size()), 0);
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    lua_pushnumber(L, numbers[i]);
    lua_rawseti(L, -2, static_cast<lua_Integer>(i + 1));
  }
  return 1;
}
int Call::flag(bool value) const {
  lua_pushboolean(L, value);
  return 1;
}

void push_function(lua_State* L, const Class* owner, const Binding& binding) {
  lua_pushlightuserdata(L, const_cast<Binding*>(&binding));
  lua_pushlightuserdata(L, const_cast<Class*>(owner));
  lua_pushcclosure(L, invoke, 2);
}

Bound bound_function(lua_State* L, int index) {
  if (lua_tocfunction(L, index) != invoke) return {};
  Bound bound;
  if (lua_getupvalue(L, index, 1) != nullptr)
    bound.row = static_cast<const Binding*>(lua_touserdata(L, -1));
  if (lua_getupvalue(L, index, 2) != nullptr)
    bound.owner = static_cast<const Class*>(lua_touserdata(L, -1));
  lua_pop(L, 2);
  return bound;
}

void remember_results(lua_State* L, const Binding& binding, int count) {
  Context& context = context_of(L);
  if (!context.remembers_results || count < 1) return;
  const double number = lua_type(L, -count) == LUA_TNUMBER ? lua_tonumber(L, -count) : std::nan("");
  context.last_result = {&binding, number, lua_topointer(L, -count)};
}

void open_classes(lua_State* L, const std::vector<const Class*>& classes) {
  for (const Class* kind : classes) open_class(L, *kind);
}

void open_globals(lua_State* L, const std::vector<Binding>& functions) {
  for (const Binding& function : functions) {
    push_function(L, nullptr, function);
    lua_setglobal(L, function.name.c_str());
  }
}

void push_handle(lua_State* L, const Class& kind, std::shared_ptr<void> object) {
  new (lua_newuserdatauv(L, sizeof(Handle), 1)) Handle{std::move(object)};
  luaL_setmetatable(L, kind.name.c_str());
}

void set_field_below(lua_State* L, const char* name) {
  if (lua_getiuservalue(L, -1, 1) != LUA_TTABLE) {
    lua_pop(L, 1);
    lua_newtable(L);
    lua_pushvalue(L, -1);
    lua_setiuservalue(L, -3, 1);
  }
  lua_pushvalue(L, -3);  // field, handle, table, field
  lua_setfield(L, -2, name);
  lua_pop(L, 1);
  lua_remove(L, -2);
}

const Class* handle_class(lua_State* L, int index) {
  if (lua_type(L, index) != LUA_TUSERDATA || !lua_getmetatable(L, index)) return nullptr;
  lua_rawgetp(L, -1, &kClassKey);
  const auto* kind = static_cast<const Class*>(lua_touserdata(L, -1));
  lua_pop(L, 2);
  return kind;
}

void* handle_object(lua_State* L, int index) { return handle_at(L, index).object.get(); }

void close_handle(Call& call) { handle_at(call.L, 1).object.reset(); }

}  // namespace vitreo::lua
