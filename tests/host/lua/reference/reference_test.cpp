// Texts printed from the rows of the bindings: help, completion, stubs for editors, luacheck's
// names, the reference.
// SPDX-License-Identifier: Apache-2.0
#include "host/lua/reference/reference.h"

#include "host/lua/engine/library.h"
#include "host/lua/interpreter/errors.h"
#include "host/lua/interpreter/state.h"
#include "host/lua/prompt/completion.h"
#include "host/lua/reference/api_reference.h"
#include "host/lua/reference/editor_files.h"
#include "host/lua/reference/everyday_calls.h"
#include "host/lua/reference/script_library.h"
#include "host/text/units.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <map>
#include <regex>
#include <set>
#include <sstream>
#include <unistd.h>

namespace vitreo::lua {
namespace VITREO_TEST_FILE {

std::string read_text(const std::filesystem::path& file) {
  std::ifstream in(file);
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

bool has(const std::vector<std::string>& words, const std::string& word) {
  return std::find(words.begin(), words.end(), word) != words.end();
}

void check_units(const Argument& argument, const std::string& call) {
  EXPECT_TRUE(argument.unit.empty() || find_unit(argument.unit))
      << call << ": " << argument.name << " in " << argument.unit;
  if (argument.type == Type::handle) {
    EXPECT_NE(find_class(library(), argument.handle), nullptr) << call << ": " << argument.name;
  }
  for (const Argument& option : argument.options) check_units(option, call);
}

void check_units(const std::vector<ResultField>& fields, const std::string& call) {
  for (const ResultField& field : fields) {
    EXPECT_TRUE(find_unit(field.unit)) << call << ": " << field.name << " in " << field.unit;
    check_units(field.fields, call);
  }
}

TEST(Reference, EveryCallHasTextUnitsThatExistAndAnExampleThatIsLua) {
  const State state(library(), nullptr, {});
  lua_State* const L = state.main();
  for (const Entry& entry : all_entries(library())) {
    const std::string call = full_name(entry.owner, *entry.row);
    EXPECT_FALSE(entry.row->doc.empty()) << call;
    for (const Argument& argument : entry.row->arguments) check_units(argument, call);
    EXPECT_TRUE(find_unit(entry.row->returns.unit)) << call;
    check_units(entry.row->returns.fields, call);
    const std::string text = "return " + example(entry);
    EXPECT_EQ(luaL_loadbufferx(L, text.data(), text.size(), "=example", "t"), LUA_OK)
        << call << ": " << text << ": " << lua_tostring(L, -1);
    lua_pop(L, 1);
    EXPECT_NE(example(entry).find(entry.row->name), std::string::npos) << call;
  }
}

TEST(Reference, TheUnitOfAResultIsReadFromTheRow) {
  EXPECT_EQ(unit_of_result(*find_entry(library(), "stage:position")->row), "m");
  EXPECT_EQ(unit_of_result(*find_entry(library(), "coils:currents")->row), "A");
  EXPECT_EQ(unit_of_result(*find_entry(library(), "trajectory:at")->row), "")
      << "a position and a velocity have not one unit";
  EXPECT_EQ(unit_of_result(*find_entry(library(), "stage:info")->row), "");
}

TEST(Reference, TheUnitsOfATablesFieldsAreReadFromTheRow) {
  using Units = std::map<std::string, std::string>;
  EXPECT_EQ(units_of_fields(*find_entry(library(), "camera:info")->row),
            (Units{{"frame_period", "s"}, {"effective_pixel", "m"}}));
  EXPECT_EQ(units_of_fields(*find_entry(library(), "servo:status")->row).at("disturbance"), "m/s");
  EXPECT_EQ(units_of_fields(*find_entry(library(), "stage:position")->row), Units())
      << "a list has one unit";
}

/// Runs the stubs in a plain Lua; what they define is left in the state.
class Stubs : public testing::Test {
 protected:
  Stubs() : L_(luaL_newstate()) {
    luaL_openlibs(L_);
    for (const auto& [name, text] : lua_stubs(library())) {
      EXPECT_TRUE(text.starts_with("---@meta")) << name;
      EXPECT_EQ(luaL_loadbufferx(L_, text.data(), text.size(), name.c_str(), "t"), LUA_OK)
          << lua_tostring(L_, -1);
      lua_pop(L_, 1);
    }
    const std::string text = lua_stubs(library()).at("vitreo.lua");
    if (luaL_dostring(L_, text.c_str()) != LUA_OK) ADD_FAILURE() << lua_tostring(L_, -1);
  }
  ~Stubs() override { lua_close(L_); }

  std::set<std::string> functions_of_top() {
    std::set<std::string> names;
    for (lua_pushnil(L_); lua_next(L_, -2) != 0; lua_pop(L_, 1))
      if (lua_isfunction(L_, -1)) names.insert(lua_tostring(L_, -2));
    return names;
  }
  /// Of the function on top, self left out; -1 for any number.
  int parameters_of_top(bool method) {
    lua_Debug about = {};
    lua_pushvalue(L_, -1);
    lua_getinfo(L_, ">u", &about);
    return about.isvararg != 0 ? -1 : about.nparams - (method ? 1 : 0);
  }
  static int wanted(const Binding& row) {
    const bool any = !row.arguments.empty() && row.arguments.back().name == "...";
    return any ? -1 : static_cast<int>(row.arguments.size());
  }

  lua_State* const L_;
};

TEST_F(Stubs, HaveTheMethodsOfTheRunTimeWithTheirArgumentsAndNoOthers) {
  const State state(library(), nullptr, {});
  const int classes = lua_gettop(L_);
  for (const Class* kind : library().classes) {
    ASSERT_EQ(lua_getfield(L_, classes, kind->name.c_str()), LUA_TTABLE) << kind->name;
    std::set<std::string> at_run_time;
    in_lua(state.main(), 0, [&] {  // the table of methods, as scripts reach it
      lua_State* const R = state.main();
      luaL_getmetatable(R, kind->name.c_str());
      lua_getfield(R, -1, "__index");
      ASSERT_NE(lua_getupvalue(R, -1, 1), nullptr);
      for (lua_pushnil(R); lua_next(R, -2) != 0; lua_pop(R, 1)) {
        const Bound bound = bound_function(R, lua_gettop(R));
        ASSERT_NE(bound.row, nullptr);
        at_run_time.insert(lua_tostring(R, -2));
        if (lua_getfield(L_, -1, bound.row->name.c_str()) == LUA_TFUNCTION) {
          EXPECT_EQ(parameters_of_top(true), wanted(*bound.row))
              << kind->name << ":" << bound.row->name;
        }
        lua_pop(L_, 1);
      }
      lua_settop(R, 0);
    });
    EXPECT_EQ(functions_of_top(), at_run_time) << kind->name;
    lua_pop(L_, 1);
  }
}

TEST_F(Stubs, HaveTheFunctionsOfTheModulesWithTheirArgumentsAndNoOthers) {
  const State state(library(), nullptr, {});
  lua_State* const R = state.main();
  for (const std::string& module : module_names(library())) {
    std::set<std::string> at_run_time;
    in_lua(R, 0, [&] {
      push_path(R, module);
      ASSERT_TRUE(lua_istable(R, -1)) << module;
      for (lua_pushnil(R); lua_next(R, -2) != 0; lua_pop(R, 1))
        if (lua_isfunction(R, -1)) at_run_time.insert(lua_tostring(R, -2));
      lua_settop(R, 0);
    });
    lua_pushglobaltable(L_);
    std::istringstream parts(module);
    for (std::string part; std::getline(parts, part, '.');)
      ASSERT_EQ(lua_getfield(L_, -1, part.c_str()), LUA_TTABLE);
    EXPECT_EQ(functions_of_top(), at_run_time) << module;
    for (const std::string& name : at_run_time) {
      lua_getfield(L_, -1, name.c_str());
      EXPECT_EQ(parameters_of_top(false), wanted(*find_entry(library(), module + "." + name)->row))
          << module << "." << name;
      lua_pop(L_, 1);
    }
  }
}

TEST(Completion, ComesFromTheLiveObjectsAndFromTheRowsAndCallsNothing) {
  const State state(library(), nullptr, {});
  lua_State* const L = state.main();
  in_lua(L, 0, [&] {
    luaL_dostring(L, "trap = setmetatable({here = 1}, {__index = function() error('called') end})");
    const auto at_end = [L](const std::string& line) { return completions(L, line, line.size()); };
    EXPECT_TRUE(has(at_end("control."), "control.line"));
    EXPECT_TRUE(has(at_end("x = 3 + contr"), "control"));
    EXPECT_TRUE(has(at_end("vision.focus_m"), "vision.focus_measures"));
    EXPECT_EQ(at_end("trap."), std::vector<std::string>{"trap.here"});
    EXPECT_TRUE(at_end("trap.nowhere.").empty());
    EXPECT_TRUE(has(at_end("control.line { from = a, sp"), "speed = "));
    EXPECT_TRUE(has(at_end("optics.system { name = \"nav"), "navarro"));
    EXPECT_TRUE(has(at_end("vision.autofocus { strategy = \"fib"), "fibonacci"));
    EXPECT_TRUE(at_end("'just a text with contr").empty());
    EXPECT_TRUE(has(at_end("help('servo:go"), "servo:go_to"));
    EXPECT_TRUE(at_end(std::string("\0\xff(", 3) + std::string(10000, '(')).size() > 10);
    lua_settop(L, 0);
  });
}

TEST(Luacheck, KnowsWhatScriptsSeeAndNothingElse) {
  const std::string text = luacheck_standard(library());
  for (const char* name :
       {"  vector = {}", "    line = {}", "    focus_peak = {}", "  pairs = {}", "  require = {}"})
    EXPECT_NE(text.find(name), std::string::npos) << name;
  for (const char* name : {" io = ", " dofile = ", " execute = ", " debug = "})
    EXPECT_EQ(text.find(name), std::string::npos) << name << ": the sandbox has none";
}

std::vector<std::filesystem::path> shipped_scripts() {
  std::vector<std::filesystem::path> files;
  for (const char* folder : {"protocols", "scripts", "templates"})
    for (const auto& entry :
         std::filesystem::recursive_directory_iterator(VITREO_SOURCE_DIR "/" + std::string(folder)))
      if (entry.path().extension() == ".lua") files.push_back(entry.path());
  return files;
}

TEST(Luacheck, PassesEveryShippedScript) {
  if (std::system("command -v luacheck >/dev/null") != 0)
    GTEST_SKIP() << "lua-check is not installed";
  const auto folder =
      std::filesystem::temp_directory_path() / ("vitreo_luacheck_" + std::to_string(getpid()));
  std::filesystem::create_directories(folder);
  std::ofstream(folder / "rc") << luacheck_standard(library());
  std::string command = "luacheck --no-color -q --config '" + (folder / "rc").string() + "'";
  for (const auto& file : shipped_scripts()) command += " '" + file.string() + "'";
  EXPECT_EQ(std::system((command + " >'" + (folder / "out").string() + "' 2>&1").c_str()), 0)
      << read_text(folder / "out");
  std::ofstream(folder / "bad.lua") << "return control.lin(1)\n";
  EXPECT_NE(std::system(("luacheck -q --config '" + (folder / "rc").string() + "' '" +
                         (folder / "bad.lua").string() + "' >/dev/null")
                            .c_str()),
            0)
      << "an unknown call is caught";
  std::filesystem::remove_all(folder);
}

/// luacheck does not know what a parameter is; the methods that scripts call on handles are looked
/// up here.
TEST(Scripts, CallOnlyMethodsThatThereAre) {
  std::set<std::string> known{"norm",  "dot",   "format", "gsub", "sub",  "rep", "upper",
                              "lower", "match", "gmatch", "find", "byte", "len"};
  for (const Entry& entry : all_entries(library()))
    if (entry.owner != nullptr) known.insert(entry.row->name);
  // What an instrument's file has in its functions and in its emulator.
  for (const char* name : {"ask", "send", "read", "sleep", "now", "fail", "pack", "unpack", "at",
                           "glide", "gliding", "later"})
    known.insert(name);
  const std::regex call(R"(([A-Za-z_][A-Za-z_0-9.]*):([A-Za-z_][A-Za-z_0-9]*)\s*[({\"])");
  const std::regex defined(R"(function\s+[A-Za-z_][A-Za-z_0-9.]*:([A-Za-z_][A-Za-z_0-9]*))");
  std::map<std::string, std::string> texts;
  for (const auto& file : shipped_scripts()) {
    std::string& text = texts[file];
    text = std::regex_replace(read_text(file), std::regex("--[^\n]*|\"[^\"\n]*\""), "\"\"");
    for (std::sregex_iterator it(text.begin(), text.end(), defined), end; it != end; ++it)
      known.insert((*it)[1]);
  }
  for (const auto& [file, text] : texts) {
    for (std::sregex_iterator it(text.begin(), text.end(), call), end; it != end; ++it)
      EXPECT_TRUE(known.contains((*it)[2])) << file << ": " << (*it)[0];
  }
}

constexpr const char* kScripts = VITREO_SOURCE_DIR "/scripts";

/// Whether a protocol has the call: its name alone, since a handle has many names.
bool in_protocols(const std::string& call) {
  const std::size_t colon = call.find(':');
  const std::regex used((colon == std::string::npos ? "\\b" + call : call.substr(colon)) + "\\b");
  for (const auto& file : shipped_scripts())
    if (file.string().find("/protocols/") != std::string::npos &&
        std::regex_search(read_text(file), used))
      return true;
  return false;
}

TEST(Card, NamesCallsThatThereAreAndThatProtocolsUse) {
  EXPECT_EQ(std::size(kEverydayCalls), 25U);
  std::set<std::string> known, named;
  for (const Entry& entry : all_entries(library()))
    known.insert(full_name(entry.owner, *entry.row));
  for (const char* const call : kEverydayCalls) {
    EXPECT_TRUE(known.contains(call)) << call;
    EXPECT_TRUE(in_protocols(call)) << call;
    EXPECT_TRUE(named.insert(call).second) << call << " stands there twice";
  }
}

TEST(ScriptLibrary, ReadsTheCommentRightAboveAFunction) {
  const ScriptModule module = read_script_module("a.b", R"(-- Purpose over
-- two lines.
-- SPDX-License-Identifier: Apache-2.0
local made = {}

--- First line
--- and second.
function made.one(a, b) return a + b end

--- About nothing.

function made.two(
  long,
  list
)
  --- inside of it
end

-- no text for users
function made:three() end

local function hidden() end
return made
)");
  EXPECT_EQ(module.purpose, "Purpose over two lines.");
  EXPECT_EQ(module.table, "made");
  ASSERT_EQ(module.functions.size(), 3U);
  EXPECT_EQ(module.functions[0].name, "made.one");
  EXPECT_EQ(module.functions[0].arguments, "a, b");
  EXPECT_EQ(module.functions[0].text, "First line and second.");
  EXPECT_EQ(module.functions[1].arguments, "long, list");
  EXPECT_EQ(module.functions[1].text, "");
  EXPECT_EQ(module.functions[2].name, "made:three");
  EXPECT_EQ(module.functions[2].text, "");
}

TEST(ScriptLibrary, ReadsTheOptionsOfAFunctionFromItsBody) {
  const ScriptModule module = read_script_module("a", R"(local made = {}
--- Goes there.
function made.go(servo, options)
  for _ = 1, options.rounds or 2 do
    servo:go(options.place, options.within or 400 * um, options.center or vector(0, 0, 0))
    servo:go(options.place, options.quick and options.rounds)
  end
end
function made.short(options) return options.side end
local function hidden(options) return options.secret end
function made.none(place) return place.options.depth end
return made
)");
  ASSERT_EQ(module.functions.size(), 3U);
  EXPECT_EQ(
      module.functions[0].options,
      (std::vector<std::string>{"rounds (2)", "place", "within (400 * um)", "center", "quick"}));
  EXPECT_EQ(description_of(module.functions[0]),
            "Goes there. Options: rounds (2), place, within (400 * um), center, quick.");
  EXPECT_EQ(title_of(module.functions[0]), "made.go(servo, options)");
  EXPECT_TRUE(module.functions[1].options.empty()) << "of one line: its comment says it";
  EXPECT_TRUE(module.functions[2].options.empty());
}

/// The functions in the table that require(name) gives, as Lua has them.
std::set<std::string> exported(const std::string& name) {
  const State state(library(), nullptr, {kScripts});
  lua_State* const L = state.main();
  std::set<std::string> names;
  in_lua(L, 0, [&] {
    lua_getglobal(L, "require");
    lua_pushstring(L, name.c_str());
    lua_call(L, 1, 1);
    if (lua_istable(L, -1))
      for (lua_pushnil(L); lua_next(L, -2) != 0; lua_pop(L, 1))
        if (lua_isfunction(L, -1) && lua_type(L, -2) == LUA_TSTRING)
          names.insert(lua_tostring(L, -2));
    lua_settop(L, 0);
  });
  return names;
}

TEST(ScriptLibrary, HasEveryExportedFunctionWithItsText) {
  const std::vector<ScriptModule> modules = script_modules(kScripts);
  EXPECT_GE(modules.size(), 25U);
  std::size_t functions = 0;
  for (const ScriptModule& module : modules) {
    EXPECT_FALSE(module.purpose.empty()) << module.name;
    std::set<std::string> read;
    for (const ScriptFunction& function : module.functions) {
      EXPECT_FALSE(function.text.empty())
          << module.name << ": " << function.name << " wants a line with --- above it";
      if (function.name.starts_with(module.table + ".") ||
          function.name.starts_with(module.table + ":"))
        read.insert(function.name.substr(module.table.size() + 1));
    }
    EXPECT_EQ(read, exported(module.name)) << module.name;
    functions += read.size();
  }
  EXPECT_GE(functions, 90U);
}

TEST(ApiReference, HoldsEveryCallAndTheOneInDocsIsIt) {
  const std::string text = api_reference(library(), script_modules(kScripts));
  for (const Entry& entry : all_entries(library()))
    EXPECT_NE(text.find("### `" + full_name(entry.owner, *entry.row) + "`"), std::string::npos);
  EXPECT_NE(text.find("| `statistics.mean(values)` |"), std::string::npos);
  EXPECT_EQ(read_text(VITREO_SOURCE_DIR "/docs/reference/api.md"), text)
      << "make reference prints it anew";
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::lua
