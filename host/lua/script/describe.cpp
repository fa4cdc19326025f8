// Shape of a protocol, checked without running it.
// SPDX-License-Identifier: Apache-2.0
#include "devices/scripted/declaration.h"
#include "host/config/config.h"
#include "host/config/config_lines.h"
#include "host/lua/interpreter/binding.h"
#include "host/lua/interpreter/errors.h"
#include "host/lua/interpreter/state.h"
#include "host/lua/interpreter/stop.h"
#include "host/lua/interpreter/values.h"
#include "host/lua/rig/classes.h"
#include "host/lua/script/reading.h"
#include "host/text/columns.h"

#include <algorithm>
#include <cmath>
#include <filesystem>

namespace vitreo::lua {
namespace {

/// One table of the file, read key by key; errors name file, line and key.
class Reader {
 public:
  Reader(lua_State* state, int index, const ProtocolDescription& protocol, std::string path)
      : L(state), index_(lua_absindex(state, index)), protocol_(protocol), path_(std::move(path)) {}
  lua_State* const L;

  [[noreturn]] void fail(const std::string& key, const std::string& problem) const {
    const std::string name = path_ + key;
    const int line = find_line(protocol_.text, name);
    throw ScriptError(protocol_.file + ":" + (line > 0 ? std::to_string(line) + ":" : "") + " " +
                      name + " " + problem);
  }

  /// Fails for a key that is none of these: what is misspelt would be left out silently.
  void known(const std::vector<std::string>& keys) const {
    push_sorted_keys(L, index_);
    for (lua_Integer i = 1; i <= static_cast<lua_Integer>(lua_rawlen(L, -1)); ++i) {
      lua_rawgeti(L, -1, i);
      const std::string key = plain_text(L, -1);
      lua_pop(L, 1);
      if (std::find(keys.begin(), keys.end(), key) != keys.end()) continue;
      const std::string near = nearest(key, keys);
      fail(key, "is not known" + (near.empty() ? "" : "; did you mean " + near + "?"));
    }
    lua_pop(L, 1);
  }

  /// Pushes the value; its Lua type.
  int push(const std::string& key) const { return lua_getfield(L, index_, key.c_str()); }
  bool has(const std::string& key) const {
    const bool there = push(key) != LUA_TNIL;
    lua_pop(L, 1);
    return there;
  }

  /// "" where it is absent and not needed.
  std::string text(const std::string& key, bool needed) const {
    const int type = push(key);
    if (type == LUA_TNIL && !needed) {
      lua_pop(L, 1);
      return "";
    }
    if (type != LUA_TSTRING) fail(key, "wants a string, got " + kind_of(L, -1));
    std::string value = lua_tostring(L, -1);
    lua_pop(L, 1);
    if (needed && value.empty()) fail(key, "is empty");
    return value;
  }

  /// Infinite limits pass; a NaN would be within every limit, and is refused.
  double number(const std::string& key, double fallback) const {
    const int type = push(key);
    const double value = type == LUA_TNIL ? fallback : lua_tonumber(L, -1);
    if (type != LUA_TNIL && (type != LUA_TNUMBER || std::isnan(value)))
      fail(key, "wants a number, got " + kind_of(L, -1));
    lua_pop(L, 1);
    return value;
  }

  bool flag(const std::string& key) const {
    const int type = push(key);
    if (type != LUA_TNIL && type != LUA_TBOOLEAN)
      fail(key, "wants true or false, got " + kind_of(L, -1));
    const bool value = lua_toboolean(L, -1);
    lua_pop(L, 1);
    return value;
  }

  std::vector<std::string> texts(const std::string& key) const {
    std::vector<std::string> values;
    const int type = push(key);
    if (type != LUA_TNIL && type != LUA_TTABLE)
      fail(key, "wants a list of strings, got " + kind_of(L, -1));
    for (lua_Integer i = 1; type == LUA_TTABLE && i <= static_cast<lua_Integer>(lua_rawlen(L, -1));
         ++i) {
      if (lua_rawgeti(L, -1, i) != LUA_TSTRING)
        fail(key, "wants a list of strings, got one with " + kind_of(L, -1));
      values.emplace_back(lua_tostring(L, -1));
      lua_pop(L, 1);
    }
    lua_pop(L, 1);
    return values;
  }

 private:
  const int index_;
  const ProtocolDescription& protocol_;
  const std::string path_;
};

/// `dimension`: limits and default are in SI by now, as `5 * um` leaves no trace of its unit.
void check_limits(const Reader& reader, const Parameter& parameter, const std::string& dimension) {
  if (parameter.min > parameter.max)
    reader.fail("min", "(" + format_quantity(parameter.min, dimension) + ") is above max (" +
                           format_quantity(parameter.max, dimension) + ")");
  const auto* const several = std::get_if<std::vector<double>>(&parameter.fallback);
  const std::vector<double> values =
      several != nullptr ? *several : std::vector{std::get<double>(parameter.fallback)};
  for (const double value : values) {
    if (!std::isfinite(value)) reader.fail("default", "wants a finite number");
    if (value < parameter.min || value > parameter.max)
      reader.fail("default", "(" + format_quantity(value, dimension) +
                                 ") is outside of its own range, " +
                                 format_range(parameter.min, parameter.max, dimension));
    if (parameter.kind == ParameterKind::integer && value != std::floor(value))
      reader.fail("default", "wants a whole number, since integer = true");
  }
}

/// Unit and bounds, when kind and default are known.
void read_bounds(const Reader& reader, Parameter& parameter) {
  parameter.unit = reader.text("unit", false);
  parameter.min = reader.number("min", parameter.min);
  parameter.max = reader.number("max", parameter.max);
  const auto unit = find_unit(parameter.unit);
  if (!unit) {
    std::vector<std::string> symbols;
    for (const Unit& known : units()) symbols.emplace_back(known.symbol);
    const std::string near = nearest(parameter.unit, symbols);
    reader.fail("unit", "'" + parameter.unit + "' is not a unit" +
                            (near.empty() ? "" : "; did you mean " + near + "?"));
  }
  check_limits(reader, parameter, std::string(unit->dimension));
}

void read_number(const Reader& reader, Parameter& parameter) {
  parameter.kind = reader.flag("integer") ? ParameterKind::integer : ParameterKind::number;
  parameter.fallback = reader.number("default", 0);
  read_bounds(reader, parameter);
}

/// A default of several numbers: vector(x, y, z); {0.1, 0.2} a list, or with range = true a range.
void read_several(const Reader& reader, Parameter& parameter) {
  const bool range = reader.flag("range");
  reader.push("default");
  const auto numbers = to_numbers(reader.L, -1);
  if (!numbers || numbers->empty())
    reader.fail("default", "wants a number, several in a table, a vector, a string, true or false");
  const std::vector<double>& values = *numbers;
  const bool vector = lua_getmetatable(reader.L, -1) != 0;  // of the tables that vector() makes
  lua_pop(reader.L, vector ? 2 : 1);
  parameter.kind = vector  ? ParameterKind::vector
                   : range ? ParameterKind::range
                           : ParameterKind::list;
  if (range &&
      (parameter.kind != ParameterKind::range || values.size() != 2 || !(values[0] <= values[1])))
    reader.fail("default", "wants {least, most}, since range = true");
  parameter.fallback = values;
  read_bounds(reader, parameter);
}

void read_choice(const Reader& reader, Parameter& parameter) {
  parameter.kind = ParameterKind::choice;
  parameter.choices = reader.texts("choices");
  const std::string fallback = reader.text("default", true);
  parameter.fallback = fallback;
  const auto& choices = parameter.choices;
  if (choices.empty()) reader.fail("choices", "is empty");
  if (std::find(choices.begin(), choices.end(), fallback) == choices.end())
    reader.fail("default", "'" + fallback + "' is not among its choices");
}

/// The kind follows from what is given: required, choices, else the type of the default.
Parameter read_parameter(const Reader& reader, const std::string& name) {
  reader.known(
      {"default", "min", "max", "unit", "choices", "integer", "range", "help", "required"});
  Parameter parameter;
  parameter.name = name;
  parameter.help = reader.text("help", false);
  const int type = reader.push("default");
  lua_pop(reader.L, 1);
  parameter.required = reader.flag("required");
  if (parameter.required) {
    if (type != LUA_TNIL || reader.has("choices"))
      reader.fail("required", "is for texts that have no default and no choices");
    parameter.kind = ParameterKind::text;
    parameter.fallback = std::string();
  } else if (reader.has("choices")) {
    read_choice(reader, parameter);
  } else if (type == LUA_TNUMBER) {
    read_number(reader, parameter);
  } else if (type == LUA_TBOOLEAN) {
    parameter.kind = ParameterKind::flag;
    parameter.fallback = reader.flag("default");
  } else if (type == LUA_TSTRING) {
    parameter.kind = ParameterKind::text;
    parameter.fallback = reader.text("default", false);
  } else if (type == LUA_TNIL) {
    reader.fail("default", "is missing: every parameter needs one, or required = true");
  } else {
    read_several(reader, parameter);
  }
  for (const char* key : {"min", "max", "unit"})
    if (!is_numeric(parameter.kind) && reader.has(key)) reader.fail(key, "is only for numbers");
  if (reader.has("integer") && (!is_numeric(parameter.kind) || is_several(parameter.kind)))
    reader.fail("integer", "is only for numbers");
  if (reader.has("range") && !is_several(parameter.kind))
    reader.fail("range", "is only for a default of two numbers, {least, most}");
  return parameter;
}

/// A name is written in Lua (p.hold) and on the command line (hold=5s): ASCII, in any locale.
bool is_name(const std::string& name) {
  constexpr const char* kLetters =
      "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ_0123456789";
  return !name.empty() && !std::isdigit(static_cast<unsigned char>(name[0])) &&
         name.find_first_not_of(kLetters) == std::string::npos;
}

/// In the order of their names: a table has no order of its own.
void read_parameters(const Reader& root, ProtocolDescription& protocol) {
  lua_State* const L = root.L;
  const int type = root.push("parameters");
  if (type == LUA_TNIL) return;
  if (type != LUA_TTABLE) root.fail("parameters", "wants a table, got " + kind_of(L, -1));
  const int table = lua_gettop(L);
  push_sorted_keys(L, table);
  for (lua_Integer i = 1; i <= static_cast<lua_Integer>(lua_rawlen(L, table + 1)); ++i) {
    lua_rawgeti(L, table + 1, i);
    const std::string name = plain_text(L, -1);
    if (!is_name(name))
      root.fail("parameters", "has '" + name + "', which is not a name: letters, digits and _");
    if (lua_rawget(L, table) != LUA_TTABLE)
      root.fail("parameters." + name,
                "wants a table such as {default = 1, min = 0, max = 2}, got " + kind_of(L, -1));
    protocol.parameters.push_back(
        read_parameter(Reader(L, -1, protocol, "parameters." + name + "."), name));
    lua_pop(L, 1);
  }
}

void read_test_results(const Reader& test, ProtocolTest& made) {
  if (test.push("results") != LUA_TTABLE) return;
  const int table = lua_gettop(test.L);
  for (const std::string& name : text_keys(test.L, table)) {
    lua_getfield(test.L, table, name.c_str());
    const auto range = to_numbers(test.L, -1);
    if (!range || range->size() != 2) test.fail("results", "." + name + " wants {least, most}");
    made.results[name] = {(*range)[0], (*range)[1]};
    lua_pop(test.L, 1);
  }
  lua_settop(test.L, table - 1);
}

/// An entry as scripts/testing.lua makes it, which refuses misspelt keys with the line of the call.
ProtocolTest read_test(const Reader& test) {
  ProtocolTest made;
  const std::string kind = test.text("test", true);
  if (kind != "run" && kind != "fail" && kind != "stop")
    test.fail("test", "is run, fail or stop: see scripts/testing.lua");
  made.kind = kind == "run"    ? ProtocolTest::Kind::run
              : kind == "fail" ? ProtocolTest::Kind::fail
                               : ProtocolTest::Kind::stop;
  made.arguments = test.text("arguments", false), made.answers = test.text("answers", false);
  made.rig = test.text("rig", false), made.fault = test.text("fault", false);
  made.outcome = test.text("outcome", false), made.says = test.text("says", false);
  if (test.has("seed")) made.seed = static_cast<std::uint64_t>(test.number("seed", 1));
  if (test.has("times")) made.times = static_cast<int>(test.number("times", 100));
  if (made.times < 1 || made.times > 100000) test.fail("times", "wants 1 to 100000");
  read_test_results(test, made);
  return made;
}

void read_tests(const Reader& root, ProtocolDescription& protocol) {
  const int type = root.push("tests");
  if (type == LUA_TNIL) return;
  if (type != LUA_TTABLE) root.fail("tests", "wants a list, got " + kind_of(root.L, -1));
  const int list = lua_gettop(root.L);
  for (lua_Integer i = 1; i <= static_cast<lua_Integer>(lua_rawlen(root.L, list)); ++i) {
    if (lua_rawgeti(root.L, list, i) != LUA_TTABLE)
      root.fail("tests",
                "wants entries as testing.test_run makes them, got " + kind_of(root.L, -1));
    protocol.tests.push_back(
        read_test(Reader(root.L, -1, protocol, "tests." + std::to_string(i) + ".")));
    lua_settop(root.L, list);
  }
}

bool is_role_name(const std::string& name) {
  return !name.empty() && name[0] >= 'a' && name[0] <= 'z' &&
         name.find_first_not_of("abcdefghijklmnopqrstuvwxyz_0123456789") == std::string::npos;
}

void read_needs(const Reader& root, ProtocolDescription& protocol) {
  protocol.needs = root.texts("needs");
  const std::vector<std::string>& roles = rig_class().fields;
  for (const std::string& need : protocol.needs) {
    if (std::find(roles.begin(), roles.end(), need) != roles.end()) continue;
    // A kind of which a rig has any number, under names of its own: "sensor:temperature".
    if (scripted::is_free(need.substr(0, need.find(':')))) continue;
    // Another name may be a rig's own; whether the rig has it is seen where there is one.
    const std::string near = nearest(need, roles);
    if (near.empty() && is_role_name(need)) continue;
    root.fail("needs", "has the role '" + need + "', which is not known" +
                           (near.empty() ? "" : "; did you mean " + near + "?"));
  }
}

/// The comment lines at the file's head, without their dashes.
std::string head_comment(const std::string& text) {
  std::string about;
  for (std::size_t at = 0; at < text.size();) {
    const std::size_t end = std::min(text.find('\n', at), text.size());
    std::string line = text.substr(at, end - at);
    at = end + 1;
    if (line.starts_with("#!") || line.find("SPDX-License-Identifier") != std::string::npos)
      continue;
    if (!line.starts_with("--") || line.starts_with("--[[")) break;
    line.erase(0, std::min(line.find_first_not_of("- "), line.size()));
    about += (about.empty() ? "" : "\n") + line;
  }
  return about;
}

}  // namespace

// The file's own statements run, in a state without a session: what needs instruments fails there,
// and a hook ends what does not come to its end. The function `run` is looked at, and not called.
ProtocolDescription describe_protocol(const Library& library, const std::string& file,
                                      const std::vector<std::string>& folders) {
  ProtocolDescription protocol;
  protocol.file = file;
  protocol.name = std::filesystem::path(file).stem().string();
  protocol.text = read_text_file(file);
  protocol.about = head_comment(protocol.text);
  State state(library, nullptr, folders);
  lua_State* const L = state.main();
  try {
    in_lua(L, 0, [&] {
      load_text(L, protocol.text, file);
      state.context().running = L;  // for the line of an error of the memory
      arm_reading_limit(L);
      lua_call(L, 0, 1);
      lua_sethook(L, nullptr, 0, 0);
      if (!lua_istable(L, -1))
        throw ScriptError(file +
                          ": a protocol returns a table {title =, needs =, parameters =, run =}, "
                          "this one returns " +
                          kind_of(L, -1));
      const Reader root(L, -1, protocol, "");
      root.known({"title", "needs", "rig", "simulated_only", "parameters", "run", "tests"});
      protocol.title = root.text("title", true);
      if (root.push("run") != LUA_TFUNCTION)
        root.fail("run", "wants a function(rig, p, run), got " + kind_of(L, -1));
      lua_pop(L, 1);
      read_needs(root, protocol);
      protocol.rig = root.text("rig", false);
      protocol.simulated_only = root.flag("simulated_only");
      read_parameters(root, protocol);
      read_tests(root, protocol);
      lua_settop(L, 0);
    });
  } catch (const Stopped&) {
    throw ScriptError(file +
                      ": takes too long to read: what it does belongs into its function run");
  }
  return protocol;
}

}  // namespace vitreo::lua
