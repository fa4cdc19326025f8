// require: the built-in modules, and text files of the declared folders; nothing else.
// SPDX-License-Identifier: Apache-2.0
#include "host/config/config.h"
#include "host/lua/interpreter/errors.h"
#include "host/lua/interpreter/library.h"
#include "host/lua/interpreter/state.h"
#include "host/lua/interpreter/turn.h"
#include "host/lua/interpreter/values.h"
#include "host/session/script_engine.h"
#include "host/text/units.h"

#include <filesystem>
#include <stdexcept>

namespace vitreo::lua {
namespace {

/// Key in Lua's registry: module by name, or kLoading while its file runs, by which a module that
/// needs itself is found out.
constexpr const char* kLoaded = "vitreo modules";
constexpr const char* kLoading = "is being loaded";

/// A misspelled unit is an error at once; as nil it would fail in the arithmetic after it.
int unknown_unit(lua_State* L) {
  return guarded(L, "units: ", [L]() -> int {
    std::vector<std::string> names;
    for (const Unit& unit : units()) names.push_back(unit_name(unit.symbol));
    const std::string word = plain_text(L, 2), near = nearest(word, names);
    throw std::invalid_argument("there is no unit " + word +
                                (near.empty() ? "" : "; did you mean " + near + "?"));
  });
}

/// Dots stand between parts only, so no name leads out of the folders.
bool well_formed(const std::string& name) {
  bool inside = false;
  for (const char c : name) {
    const bool letter = std::isalnum(static_cast<unsigned char>(c)) || c == '_';
    if (!letter && !(c == '.' && inside)) return false;
    inside = letter;
  }
  return inside;
}

/// A link may not lead out of the declared folder.
void check_inside(const std::filesystem::path& folder, const std::filesystem::path& file,
                  const std::string& name) {
  const std::string within =
      std::filesystem::canonical(file).lexically_relative(std::filesystem::canonical(folder));
  if (within.empty() || within.starts_with(".."))
    throw std::invalid_argument("the module '" + name + "' is a link that leads out of " +
                                folder.string());
}

/// The first folder that has it counts; empty where none has.
std::string find_module(const Context& context, const std::string& name) {
  std::string relative = name;
  for (char& c : relative) c = c == '.' ? '/' : c;
  for (const std::string& folder : context.folders) {
    const std::filesystem::path file = std::filesystem::path(folder) / (relative + ".lua");
    if (!std::filesystem::is_regular_file(file)) continue;
    check_inside(folder, file, name);
    return file.string();
  }
  return "";
}

/// Throws in any case; lists all modules to find the nearest name.
[[noreturn]] void refuse_module(const Context& context, const std::string& name) {
  std::vector<std::string> known{"units"};
  for (const Module& module : context.library->modules) known.push_back(module.name);
  for (const std::string& folder : context.folders) {
    if (!std::filesystem::is_directory(folder)) continue;
    for (const auto& entry : std::filesystem::recursive_directory_iterator(folder)) {
      if (entry.path().extension() != ".lua") continue;
      // "analysis/statistics.lua" is the module analysis.statistics
      std::string module = entry.path().lexically_relative(folder).replace_extension().string();
      for (char& c : module) c = c == '/' ? '.' : c;
      known.push_back(module);
    }
  }
  const std::string near = nearest(name, known);
  throw std::invalid_argument("there is no module '" + name + "'" +
                              (near.empty() ? "" : "; did you mean " + near + "?"));
}

/// The text goes into the record: what a run has used can be read there, whatever became of the
/// file. Leaves the compiled chunk and its argument, the name, on the stack.
void load_module(lua_State* L, const std::string& name) {
  const std::string file = find_module(context_of(L), name);
  if (file.empty()) refuse_module(context_of(L), name);
  const std::string text = read_text_file(file);
  load_text(L, text, file);
  if (Session* const session = context_of(L).session) session->recorder.module({name, file, text});
  lua_pushstring(L, kLoading);
  set_module(L, name);
  lua_pushstring(L, name.c_str());
}

/// A module runs once a run; its value, or true where it has none, is kept. One that fails is
/// forgotten, so that it can be tried again.
int require(lua_State* L) {
  const std::string name = luaL_checkstring(L, 1);
  luaL_getsubtable(L, LUA_REGISTRYINDEX, kLoaded);
  if (lua_getfield(L, -1, name.c_str()) != LUA_TNIL) {
    if (lua_type(L, -1) != LUA_TSTRING || lua_tostring(L, -1) != std::string(kLoading)) return 1;
    return luaL_error(L, "require: the module '%s' needs itself", name.c_str());
  }
  lua_settop(L, 1);
  guarded(L, "require: ", [&] {
    if (!well_formed(name))
      throw std::invalid_argument(
          "'" + name + "' is not a module's name: letters, digits, _ and dots between them");
    const HostCode host(context_of(L));
    load_module(L, name);
    return 0;
  });
  if (lua_pcall(L, 1, 1, 0) != LUA_OK) {  // so that it can be tried again at the prompt
    lua_pushnil(L);
    set_module(L, name);
    return lua_error(L);
  }
  if (lua_isnil(L, -1)) {
    lua_pop(L, 1);
    lua_pushboolean(L, 1);
  }
  lua_pushvalue(L, -1);
  set_module(L, name);
  return 1;
}

/// A variable must be assigned before it is read, so a misspelled one is found where it stands.
int undefined(lua_State* L) {
  return guarded(L, "", [L]() -> int {
    const std::string word = plain_text(L, 2);
    const std::string near = nearest(word, text_keys(L, 1));
    throw std::invalid_argument("the variable " + word + " is not defined" +
                                (near.empty() ? "" : "; did you mean " + near + "?"));
  });
}

}  // namespace

/// Pops the value.
void set_module(lua_State* L, const std::string& name) {
  luaL_getsubtable(L, LUA_REGISTRYINDEX, kLoaded);
  lua_insert(L, -2);
  lua_setfield(L, -2, name.c_str());
  lua_pop(L, 1);
}

/// Factors to SI: 5 * mm is 0.005.
void push_units(lua_State* L) {
  lua_newtable(L);
  for (const Unit& unit : units()) {
    const std::string name = unit_name(unit.symbol);
    if (name.empty()) continue;
    lua_pushnumber(L, unit.factor);
    lua_setfield(L, -2, name.c_str());
  }
  lua_createtable(L, 0, 1);
  lua_pushcfunction(L, unknown_unit);
  lua_setfield(L, -2, "__index");
  lua_setmetatable(L, -2);
}

void open_modules(lua_State* L) {
  push_units(L);
  set_module(L, "units");
  lua_pushcfunction(L, require);
  lua_setglobal(L, "require");
}

/// Reading alone is strict; a new global may be assigned.
void open_strictness(lua_State* L) {
  lua_pushglobaltable(L);
  lua_createtable(L, 0, 1);
  lua_pushcfunction(L, undefined);
  lua_setfield(L, -2, "__index");
  lua_setmetatable(L, -2);
  lua_pop(L, 1);
}

}  // namespace vitreo::lua
