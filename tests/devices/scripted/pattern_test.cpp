// Patterns with bounded work, against Lua's own functions.
// SPDX-License-Identifier: Apache-2.0
#include "devices/scripted/pattern.h"

#include "devices/scripted/sandbox.h"

#include <gtest/gtest.h>

#include <random>

namespace vitreo::scripted {
namespace VITREO_TEST_FILE {

/// Lua as it comes.
struct Plain {
  Plain() { luaL_openlibs(L); }
  ~Plain() { lua_close(L); }
  Plain(const Plain&) = delete;
  Plain& operator=(const Plain&) = delete;
  lua_State* L = luaL_newstate();
};

/// Everything that one call of each function gives, as one text; what both are asked.
constexpr const char* kAll = R"lua(
local text, pattern, with = ...
local said = {}
local function say(name, good, ...)
  said[#said + 1] = name
  if not good then
    said[#said + 1] = "error"
    return
  end
  for i = 1, select("#", ...) do said[#said + 1] = tostring((select(i, ...))) end
end
say("find", pcall(string.find, text, pattern))
say("from", pcall(string.find, text, pattern, 3))
say("back", pcall(string.find, text, pattern, -2))
say("plain", pcall(string.find, text, pattern, 1, true))
say("match", pcall(string.match, text, pattern))
say("gsub", pcall(string.gsub, text, pattern, with))
say("two", pcall(string.gsub, text, pattern, "<%0>", 2))
say("call", pcall(string.gsub, text, pattern, function(a, b) return b or a end))
say("table", pcall(string.gsub, text, pattern, { a = "1", b = false, ab = 3 }))
say("all", pcall(function()
  local all = {}
  for a, b in string.gmatch(text, pattern) do all[#all + 1] = tostring(a) .. tostring(b) end
  return table.concat(all, ";")
end))
return table.concat(said, "|")
)lua";

std::string plain(Plain& lua, const std::string& text, const std::string& pattern,
                  const std::string& with) {
  lua_State* const L = lua.L;
  luaL_loadstring(L, kAll);
  for (const std::string* one : {&text, &pattern, &with})
    lua_pushlstring(L, one->data(), one->size());
  lua_call(L, 3, 1);
  const std::string said(lua_tostring(L, -1), lua_rawlen(L, -1));
  lua_pop(L, 1);
  return said;
}

std::string bounded(Sandbox& sandbox, const Reference& all, const std::string& text,
                    const std::string& pattern, const std::string& with) {
  lua_State* const L = sandbox.stack();
  all.push();
  for (const std::string* one : {&text, &pattern, &with})
    lua_pushlstring(L, one->data(), one->size());
  sandbox.call(3, 1);
  const std::string said(lua_tostring(L, -1), lua_rawlen(L, -1));
  lua_pop(L, 1);
  return said;
}

TEST(Pattern, FindsWhatLuaFinds) {
  Plain lua;
  Sandbox sandbox("pump.lua");
  sandbox.run(std::string("return function(...) ") + kAll + " end");
  const Reference all(sandbox.stack());
  std::mt19937 random(7);
  const auto any = [&](const std::vector<std::string>& pieces, int most) {
    std::string made;
    for (int i = std::uniform_int_distribution(0, most)(random); i > 0; --i)
      made += pieces[std::uniform_int_distribution<std::size_t>(0, pieces.size() - 1)(random)];
    return made;
  };
  const std::vector<std::string> parts{
      "a", "b",   "%a", "%d",     "%s",    "%W",     ".",     "*",  "+",    "-",  "?",    "(",
      ")", "()",  "%1", "%2",     "[ab]",  "[^a]",   "[a-c]", "%b", "%b()", "^",  "$",    "[%d.]",
      "[", "%",   "]",  "%f",     "%f[a]", "%f[^b]", "[]]",   "%.", "[a-]", "%x", "(a*)", "(.-)",
      ",", "[^]", "%0", "[%a-z]", "%z",    "%g",     "%p",    " ",  "[%]]", "%u", "[b-a]"};
  const std::vector<std::string> letters{
      "a",   "b", "c", "1", "2", " ", "(", ")", ",", ".", "]", "-", "ab", "X", std::string(1, '\0'),
      "\xE9"};
  int matched = 0;
  for (int i = 0; i < 60000; ++i) {
    const std::string text = any(letters, 9), pattern = any(parts, 6),
                      with = any({"%1", "%0", "x", "%%", "%2", "%"}, 3);
    const std::string wanted = plain(lua, text, pattern, with);
    const std::string found = bounded(sandbox, all, text, pattern, with);
    if (wanted.starts_with("find|error")) {  // gsub of Lua's does not look at a capture "("
      ASSERT_TRUE(found.starts_with("find|error")) << '"' << text << "\" with \"" << pattern << '"';
      continue;
    }
    ASSERT_EQ(found, wanted) << '"' << text << "\" with \"" << pattern << '"';
    matched += wanted.find("find|1|") != std::string::npos;
  }
  EXPECT_GT(matched, 5000);
}

TEST(Pattern, HasAnEnd) {
  const std::string text(20000, 'a');
  PatternSteps steps(100000);
  EXPECT_THROW(find_pattern(text, "(.-)(.-)(.-)x", 0, steps), PatternWork);
  steps.left = 100000;
  EXPECT_THROW(find_pattern(text, ".-.-.-%f[b]", 0, steps), PatternWork);
  steps.left = 100000;
  EXPECT_THROW(find_pattern(text, std::string(500, '(') + "a", 0, steps), PatternError);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::scripted
