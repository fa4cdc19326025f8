// Global functions; help() about a name, a handle, a function, a module, a protocol, or any value.
// SPDX-License-Identifier: Apache-2.0
#include "host/config/config.h"
#include "host/lua/interpreter/context.h"
#include "host/lua/interpreter/state.h"
#include "host/lua/interpreter/values.h"
#include "host/lua/reference/reference.h"
#include "host/lua/reference/script_library.h"
#include "host/lua/run/classes.h"
#include "host/lua/script/protocol_files.h"
#include "host/lua/script/reading.h"
#include "host/session/protocol_text.h"

#include <fmt/format.h>

#include <filesystem>
#include <stdexcept>

namespace vitreo::lua {
namespace {

/// "string.format" where `word` names a function of Lua's own.
std::string lua_function_help(lua_State* L, const std::string& word) {
  // What is pushed here help() takes off the stack again.
  lua_pushglobaltable(L);
  const std::size_t dot = word.find('.');
  if (dot != std::string::npos) {
    lua_pushstring(L, word.substr(0, dot).c_str());
    if (lua_rawget(L, -2) != LUA_TTABLE) return "";
  }
  lua_pushstring(L, word.substr(dot == std::string::npos ? 0 : dot + 1).c_str());
  // The host's functions are in C++ too, but have rows of their own: Lua's manual has none.
  if (lua_rawget(L, -2) != LUA_TFUNCTION || !lua_iscfunction(L, -1) ||
      bound_function(L, lua_gettop(L)).row)
    return "";
  return word + ": a function of Lua, https://www.lua.org/manual/5.4/manual.html#pdf-" + word +
         "\n";
}

/// A bound function has its row; of one written in Lua only its place is known.
std::string function_help(lua_State* L, int index) {
  if (const Bound bound = bound_function(L, index); bound.row)
    return entry_help({bound.owner, bound.row});
  lua_Debug place = {};
  lua_pushvalue(L, index);
  // '>' takes the function off the stack, S tells its place and u how many arguments it has.
  lua_getinfo(L, ">Su", &place);
  if (std::string(place.what) == "C") return "a function of Lua\n";
  return fmt::format("a function of {} argument(s), from {}:{}\n", int{place.nparams},
                     place.short_src, place.linedefined);
}

std::string value_help(lua_State* L, int index) {
  if (const Class* const kind = handle_class(L, index)) return class_help(*kind);
  if (lua_isfunction(L, index)) return function_help(L, index);
  if (lua_istable(L, index) && to_vector(L, index))
    return "a vector {x, y, z}: v.x, v.y, v.z, v:norm(), v:dot(w), v + w, 2 * v; it is " +
           pretty(L, index) + "\n";
  return kind_of(L, index) + ": " + pretty(L, index) + "\n";
}

/// Of a module in scripts/ ("session.preparation") or of one of its functions ("bring.trim"), from
/// the comments of its source; empty where there is none.
std::string script_help(const Context& context, const std::string& word) {
  std::string text;
  for (const std::string& folder : context.folders) {
    if (std::filesystem::path(folder).filename() != "scripts") continue;
    for (const ScriptModule& module : script_modules(folder)) {
      const bool whole = module.name == word;
      if (whole) text += "require \"" + module.name + "\"\n  " + module.purpose + "\n";
      for (const ScriptFunction& function : module.functions) {
        if (!whole && function.name != word) continue;
        text += title_of(function) + "\n  " + description_of(function) + "\n";
        if (!whole) text += "  of the module " + module.name + "\n";
      }
    }
  }
  return text;
}

/// First the names that have no row, then Lua's own functions, of which its manual tells, then
/// protocols; the rows last.
std::string words_help(lua_State* L, const std::string& word) {
  if (word == "vector")
    return "vector(x, y, z)\n  a vector with arithmetic; v.x, v:norm(), v:dot(w)\n"
           "  for instance: vector(0, 0, 1 * units.mm)\n";
  if (word == "follow")
    return "follow(protocol, {parameters})\n  at the prompt: runs a protocol as run() does, shows "
           "each "
           "row that it records as a line of a table, and plots them at the end\n  for instance: "
           "follow(\"drift_test\", { hold = 2 * s })\n" +
           help_about(*context_of(L).library, "servo:follow");
  if (word == "watch")
    return "watch(object, {every, count})\n  at the prompt: shows what an object or a function "
           "tells, again and again, "
           "until Ctrl-C\n  for instance: watch(rig.stage, { every = 0.5 })\n";
  // Only at the prompt can run be called; in a protocol it is the run's own object.
  if (word == "run" && context_of(L).remembers_results)
    return class_help(run_class()) +
           "at the prompt run(\"drift_test\", {hold = 5 * s}) runs a protocol, check(...) dries "
           "it\n";
  if (std::string text = lua_function_help(L, word); !text.empty()) return text;
  const Context& context = context_of(L);
  // A path is no topic, though find_protocol() takes one.
  if (const std::string file = find_protocol(context, word);
      !file.empty() && word.find('/') == std::string::npos)
    return protocol_text(describe_protocol(*context.library, file, context.folders));
  try {
    return help_about(*context.library, word);
  } catch (const std::invalid_argument&) {
    std::string topic = topic_help(*context.library, word);
    for (const std::string& name : protocol_names(context))
      if (name.find(word) != std::string::npos) topic += "  protocol " + name + "\n";
    if (topic.empty())
      topic = script_help(context, word);
    else
      topic = "about " + word + ":\n" + topic;
    if (topic.empty()) throw;
    return topic;
  }
}

int help(Call& call) {
  lua_State* const L = call.L;
  const int top = lua_gettop(L);
  std::string text = !call.has(0)                                ? overview(*call.context().library)
                     : lua_type(L, call.index(0)) == LUA_TSTRING ? words_help(L, call.text(0))
                                                                 : value_help(L, call.index(0));
  lua_settop(L, top);
  while (text.ends_with('\n')) text.pop_back();
  if (const auto& print = call.context().print) print(text);
  return 0;
}

}  // namespace

const std::vector<Binding>& global_functions() {
  static const std::vector<Binding> functions = {
      {"help",
       {{.name = "about", .optional = true, .help = "a name, or any value"}},
       "",
       "tells what there is",
       help,
       "help(\"servo:go_to\")"},
      format_quantity_row()};
  return functions;
}

}  // namespace vitreo::lua
