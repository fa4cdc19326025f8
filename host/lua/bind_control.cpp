// The module `control`: trajectories, field models, robots.
// SPDX-License-Identifier: Apache-2.0
#include "host/lua/bind_control.h"

#include "host/config.h"
#include "host/lua/errors.h"
#include "host/lua/state.h"
#include "host/lua/values.h"

#include <stdexcept>
#include <string_view>
#include <utility>

namespace vitreo::lua {
namespace {

constexpr std::string_view kModule = "control.";

int unknown_function(lua_State* L) {
  return guarded(L, "control: ", [L]() -> int {
    std::vector<std::string> names;
    for (const Binding& row : control_functions()) names.push_back(row.name.substr(kModule.size()));
    const std::string word = plain_text(L, 2), near = nearest(word, names);
    throw std::invalid_argument("there is no " + word + (near.empty() ? "" : "; did you mean " + near + "?"));
  });
}

}  // namespace

const std::vector<Binding>& control_functions() {
  static const std::vector<Binding> functions = [] {
    std::vector<Binding> all = trajectory_functions();
    for (Binding& row : field_functions()) all.push_back(std::move(row));
    for (Binding& row : field_fit_functions()) all.push_back(std::move(row));
    return all;
  }();
  return functions;
}

void open_control(lua_State* L) {
  lua_newtable(L);
  for (const Binding& row : control_functions()) {
    push_function(L, nullptr, row);
    lua_setfield(L, -2, row.name.c_str() + kModule.size());
  }
  lua_createtable(L, 0, 1);
  lua_pushcfunction(L, unknown_function);
  lua_setfield(L, -2, "__index");
  lua_setmetatable(L, -2);
  lua_pushvalue(L, -1);
  set_module(L, "control");
  lua_setglobal(L, "control");
}

}  // namespace vitreo::lua
