// SPDX-License-Identifier: Apache-2.0
#include "host/lua/prompt/completion.h"

#include "host/lua/interpreter/values.h"
#include "host/lua/prompt/prompt_calls.h"
#include "host/lua/reference/reference.h"
#include "host/lua/script/protocol_files.h"
#include "host/lua/script/reading.h"
#include "host/terminal/line_editor.h"

#include <algorithm>
#include <cctype>

namespace vitreo::lua {
namespace {

using Words = std::vector<std::string>;

constexpr const char* kKeywords[] = {"and",   "break", "do",       "else", "elseif", "end",
                                     "false", "for",   "function", "goto", "if",     "in",
                                     "local", "nil",   "not",      "or",   "repeat", "return",
                                     "then",  "true",  "until",    "while"};

bool name_letter(char c) { return std::isalnum(static_cast<unsigned char>(c)) != 0 || c == '_'; }

/// [value] -> [field], without metamethods; nil where there is none.
void take_field(lua_State* L, const std::string& name) {
  const int at = lua_gettop(L);
  const bool handle = handle_class(L, at) != nullptr;
  if (lua_istable(L, at) || (handle && lua_getiuservalue(L, at, 1) == LUA_TTABLE)) {
    lua_pushstring(L, name.c_str());
    lua_rawget(L, -2);
  } else {
    lua_pushnil(L);
  }
  lua_replace(L, at);
  lua_settop(L, at);
}

Words text_keys_raw(lua_State* L, int index) {
  Words keys;
  for (lua_pushnil(L); lua_next(L, index) != 0; lua_pop(L, 1))
    if (lua_type(L, -2) == LUA_TSTRING) keys.emplace_back(lua_tostring(L, -2));
  return keys;
}

/// What may stand after the dot or the colon of the value on top.
Words members(lua_State* L, char separator) {
  Words words;
  const int at = lua_gettop(L);
  if (const Class* const kind = handle_class(L, at)) {
    for (const Binding& row : kind->methods) words.push_back(row.name);
    if (separator == '.') {
      words.clear();
      if (lua_getiuservalue(L, at, 1) == LUA_TTABLE) words = text_keys_raw(L, lua_gettop(L));
    }
  } else if (lua_istable(L, at) && to_vector(L, at)) {
    words = separator == ':' ? Words{"norm", "dot"} : Words{"x", "y", "z"};
  } else if (lua_istable(L, at)) {
    words = text_keys_raw(L, at);
  } else if (lua_type(L, at) == LUA_TSTRING && separator == ':') {
    lua_getglobal(L, "string");
    words = text_keys_raw(L, lua_gettop(L));
  }
  lua_settop(L, at);
  return words;
}

/// A call that is open at the cursor: its name, and what stands between its bracket and the cursor.
struct OpenCall {
  std::string name;
  bool table = false;  // inside of a table that is its argument
  bool in_quotes = false;
  std::string key;   // `key = ` before the cursor, inside of a table
  int argument = 0;  // commas before
};

/// The name that ends before `at`, blanks left out: "rig.stage:move_to".
std::string name_before(const std::string& line, std::size_t at) {
  while (at > 0 && line[at - 1] == ' ') --at;
  std::size_t begin = at;
  while (begin > 0 &&
         (name_letter(line[begin - 1]) || line[begin - 1] == '.' || line[begin - 1] == ':'))
    --begin;
  return line.substr(begin, at - begin);
}

/// Reads the line up to the cursor, brackets and quotes; the innermost bracket that belongs to a
/// call.
OpenCall open_call(const std::string& line, std::size_t cursor) {
  struct Bracket {
    std::size_t at;
    char kind;
    int commas;
  };
  std::vector<Bracket> open;
  char quote = 0;
  for (std::size_t i = 0; i < cursor; ++i) {
    const char c = line[i];
    if (quote != 0) {
      if (c == '\\') ++i;
      if (c == quote) quote = 0;
      continue;
    }
    if (c == '"' || c == '\'') quote = c;
    if (c == '(' || c == '{' || c == '[') open.push_back({i, c, 0});
    if ((c == ')' || c == '}' || c == ']') && !open.empty()) open.pop_back();
    if (c == ',' && !open.empty()) ++open.back().commas;
  }
  OpenCall call;
  call.in_quotes = quote != 0;
  if (open.empty()) {
    if (quote != 0)
      call.name = name_before(line, line.find_last_of(quote, cursor - 1));  // require "
    return call;
  }
  call.table = open.back().kind == '{';
  call.argument = open.back().commas;
  std::size_t at = open.back().at;
  if (call.table && name_before(line, at).empty() && open.size() > 1 &&
      open[open.size() - 2].kind == '(') {
    call.argument = open[open.size() - 2].commas;
    at = open[open.size() - 2].at;
  }
  call.name = name_before(line, at);
  std::size_t value = word_start(line, cursor);
  if (call.in_quotes && value > 0) --value;
  while (value > 0 && line[value - 1] == ' ') --value;
  if (value > 0 && line[value - 1] == '=') call.key = name_before(line, value - 1);
  return call;
}

const Argument* options_of(const Binding& row) {
  for (const Argument& argument : row.arguments)
    if (argument.type == Type::options) return &argument;
  return nullptr;
}

/// Of run("name", { and check("name", {: parameters of the protocol that the line names; after `key
/// =` the values that are allowed. The file is read for it, and not run.
Words parameter_words(lua_State* L, const std::string& line, const OpenCall& call) {
  const std::size_t open = line.find('"'), close = line.find('"', open + 1);
  if (open == std::string::npos || close == std::string::npos) return {};
  const Context& context = context_of(L);
  const std::string file = find_protocol(context, line.substr(open + 1, close - open - 1));
  if (file.empty()) return {};
  Words words;
  for (const Parameter& parameter :
       describe_protocol(*context.library, file, context.folders).parameters) {
    if (call.key.empty()) words.push_back(parameter.name + " = ");
    if (call.key == parameter.name) words = parameter.choices;
  }
  return words;
}

Words modules(const Library& library) {
  Words names{"units"};
  for (const Module& module : library.modules) names.push_back(module.name);
  return names;
}

/// Keys of the options, or the allowed values of a key or of the argument.
Words argument_words(lua_State* L, const std::string& line, const OpenCall& call) {
  if (call.name == "run" || call.name == "check")
    return call.table       ? parameter_words(L, line, call)
           : call.in_quotes ? protocol_names(context_of(L))
                            : Words{};
  if (call.in_quotes && call.name == "require") return modules(*context_of(L).library);
  if (call.in_quotes && call.name == "help") {
    const Library& library = *context_of(L).library;
    Words words = module_names(library);
    for (const Class* kind : library.classes) words.push_back(kind->name);
    for (const Entry& entry : all_entries(library))
      words.push_back(full_name(entry.owner, *entry.row));
    return words;
  }
  const Bound bound = bound_path(L, call.name);
  if (bound.row == nullptr) return {};
  if (!call.table) {
    const auto at = static_cast<std::size_t>(call.argument);
    return call.in_quotes && at < bound.row->arguments.size() ? bound.row->arguments[at].choices
                                                              : Words{};
  }
  Words words;
  if (const Argument* const options = options_of(*bound.row))
    for (const Argument& option : options->options) {
      if (call.key.empty() && !call.in_quotes) words.push_back(option.name + " = ");
      if (call.key == option.name && call.in_quotes) words = option.choices;
    }
  return words;
}

Words global_words(lua_State* L) {
  lua_pushglobaltable(L);
  Words words = text_keys_raw(L, lua_gettop(L));
  lua_pop(L, 1);
  words.insert(words.end(), std::begin(kKeywords), std::end(kKeywords));
  return words;
}

}  // namespace

// Raw access all the way: a metamethod could do anything, and a name that is completed must not.
void push_path(lua_State* L, const std::string& path) {
  luaL_checkstack(L, 10, "too much on the stack");
  lua_pushglobaltable(L);
  for (std::size_t begin = 0; begin <= path.size();) {
    const std::size_t end = std::min(path.find('.', begin), path.size());
    take_field(L, path.substr(begin, end - begin));
    begin = end + 1;
  }
}

Bound bound_path(lua_State* L, const std::string& path) {
  const std::size_t colon = path.rfind(':');
  push_path(L, path.substr(0, colon));
  Bound bound;
  if (colon == std::string::npos) {
    bound = bound_function(L, lua_gettop(L));
  } else if (const Class* const kind = handle_class(L, -1)) {
    for (const Binding& row : kind->methods)
      if (row.name == path.substr(colon + 1)) bound = {&row, kind};
  }
  lua_pop(L, 1);
  return bound;
}

// What the open call takes first; a name with a dot or a colon is completed from its value instead;
// where neither says anything, globals and keywords.
std::vector<std::string> completions(lua_State* L, const std::string& line, std::size_t cursor) {
  const int top = lua_gettop(L);
  cursor = std::min(cursor, line.size());
  const std::size_t begin = word_start(line, cursor);
  const std::string word = line.substr(begin, cursor - begin);
  const OpenCall call = open_call(line, cursor);
  Words found = argument_words(L, line, call);
  std::string path;
  if (const std::size_t separator = word.find_last_of(".:");
      separator != std::string::npos && !call.in_quotes) {
    path = word.substr(0, separator + 1);
    push_path(L, word.substr(0, separator));
    found = members(L, word[separator]);
  } else if (found.empty() && !call.in_quotes) {
    found = global_words(L);
  }
  Words fitting;
  for (const std::string& one : found)
    if ((path + one).starts_with(word)) fitting.push_back(path + one);
  std::sort(fitting.begin(), fitting.end());
  fitting.erase(std::unique(fitting.begin(), fitting.end()), fitting.end());
  lua_settop(L, top);
  return fitting;
}

}  // namespace vitreo::lua
