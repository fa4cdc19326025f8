// The tables of C++ functions that scripts know as `optics`, `vision`, `control` and `files`, made
// from their rows.
// SPDX-License-Identifier: Apache-2.0
#include "host/config/config.h"
#include "host/lua/interpreter/binding.h"
#include "host/lua/interpreter/errors.h"
#include "host/lua/interpreter/state.h"
#include "host/lua/interpreter/values.h"

#include <stdexcept>

namespace vitreo::lua {
namespace {

/// The upvalue is the table's own name, "vision" or "vision.color_model".
/// A name that is not there is an error with the nearest one: nil would fail later, with less to
/// say.
int unknown_function(lua_State* L) {
  const std::string table = lua_tostring(L, lua_upvalueindex(1));
  return guarded(L, table + ": ", [&]() -> int {
    const std::string word = plain_text(L, 2), near = nearest(word, text_keys(L, 1));
    throw std::invalid_argument("there is no " + word +
                                (near.empty() ? "" : "; did you mean " + near + "?"));
  });
}

/// With that __index; the table itself is a plain one that prompt completion can list.
void push_table_of_functions(lua_State* L, const std::string& name) {
  lua_newtable(L);
  lua_createtable(L, 0, 1);
  lua_pushstring(L, name.c_str());
  lua_pushcclosure(L, unknown_function, 1);
  lua_setfield(L, -2, "__index");
  lua_setmetatable(L, -2);
}

/// Puts "vision.color_model.train" into the table `color_model` of the table `vision` on top.
void add_function(lua_State* L, const std::string& module, const Binding& row) {
  const std::string path = row.name.substr(module.size() + 1);
  const std::size_t dot = path.find('.');
  if (dot == std::string::npos) {
    push_function(L, nullptr, row);
    lua_setfield(L, -2, path.c_str());
    return;
  }
  const std::string group = path.substr(0, dot);
  lua_pushstring(L, group.c_str());
  // The group's table is made with its first function.
  if (lua_rawget(L, -2) != LUA_TTABLE) {
    lua_pop(L, 1);
    push_table_of_functions(L, module + "." + group);
    lua_pushvalue(L, -1);
    lua_setfield(L, -3, group.c_str());
  }
  push_function(L, nullptr, row);
  lua_setfield(L, -2, path.c_str() + dot + 1);
  lua_pop(L, 1);
}

}  // namespace

/// Both as a global and for require, under one name.
void open_functions(lua_State* L, const std::string& name, const std::vector<Binding>& rows) {
  push_table_of_functions(L, name);
  for (const Binding& row : rows) add_function(L, name, row);
  lua_pushvalue(L, -1);
  set_module(L, name);
  lua_setglobal(L, name.c_str());
}

}  // namespace vitreo::lua
