// SPDX-License-Identifier: Apache-2.0
#include "tests/host/lua/interpreter/lua_bench.h"

#include <lua.hpp>

namespace vitreo {
namespace VITREO_TEST_FILE {

using Sandbox = LuaBench;

TEST_F(Sandbox, NothingLeadsOutOfIt) {
  for (const char* name : {"io", "debug", "package", "dofile", "loadfile", "collectgarbage",
                           "os.execute", "os.getenv", "os.remove", "os.exit", "string.dump"}) {
    const std::string field(name);
    const std::size_t dot = field.find('.');
    const std::string value = dot == std::string::npos ? "rawget(_G, '" + field + "')"
                                                       : "rawget(" + field.substr(0, dot) + ", '" +
                                                             field.substr(dot + 1) + "')";
    EXPECT_EQ(run("assert(" + value + " == nil)").error, "") << name;
  }
  EXPECT_EQ(run("assert(getmetatable('').__index == string)").error, "");
}

TEST_F(Sandbox, BytecodeIsRefused) {
  EXPECT_EQ(run("local f, why = load('\\27Lua') assert(f == nil and why:find('binary'))").error,
            "");
  EXPECT_EQ(run("assert(load('return 1 + 1')() == 2)").error, "");
  EXPECT_EQ(run("assert(load('return x', 'c', 't', {x = 3})() == 3)").error, "");
  expect_all(run("load(function() return 'x' end)").error, {"p.lua:2:", "wants a string"});
}

TEST_F(Sandbox, RequireReadsTheDeclaredFoldersOnly) {
  write("lib/places.lua", "return { six = 6 }");
  write("lib/broken.lua", "return {\n six = = 6 }");
  write("lib/circle.lua", "return require 'circle'");
  write("outside.lua", "return 1");
  EXPECT_EQ(run("assert(require('places').six == 6) assert(require('places') == require('places'))")
                .error,
            "");
  expect_all(run("require '../outside'").error, {"p.lua:2:", "not a module's name"});
  expect_all(run("require '/etc/passwd'").error, {"not a module's name"});
  expect_all(run("require '..outside'").error, {"not a module's name"});
  expect_all(run("require 'outside'").error, {"there is no module 'outside'"});
  expect_all(run("require 'place'").error, {"did you mean places"});
  expect_all(run("require 'broken'").error, {"broken.lua:2:"});
  expect_all(run("require 'circle'").error, {"needs itself"});
}

TEST_F(Sandbox, UnitsAreSiFactors) {
  EXPECT_EQ(run("local u = require 'units'\nassert(u.um == 1e-6 and u.mm_per_s == 1e-3 and u.mT == "
                "1e-3 and u.s == 1)")
                .error,
            "");
  EXPECT_EQ(run("local u = require 'units'\nassert(math.abs(u.deg*180 - math.pi) < 1e-12 and u.Hz "
                "== 1 and u.uN == 1e-6)")
                .error,
            "");
  expect_all(run("local u = require 'units'\nprint(3*u.mmm)").error,
             {"p.lua:3:", "no unit mmm", "did you mean mm"});
}

TEST_F(Sandbox, PairsWalksInAnOrderThatHoldsFromRunToRun) {
  ASSERT_EQ(run("local t = { b = 1, a = 2, [3] = 3, [1] = 4, [2.5] = 5, [true] = 6, Z = 7 }\n"
                "local keys = ''\nfor k in pairs(t) do keys = keys .. tostring(k) .. ' ' "
                "end\nprint(keys)\n"
                "keys = ''\nlocal k = next(t) while k ~= nil do keys = keys .. tostring(k) .. ' ' "
                "k = next(t, k) "
                "end\nprint(keys)")
                .error,
            "");
  EXPECT_EQ(said(0), "1 2.5 3 Z a b true ");
  EXPECT_EQ(said(1), "1 2.5 3 Z a b true ");
  expect_all(run("for k in pairs({ [{}] = 1 }) do end").error,
             {"p.lua:2:", "a key that is a table", "no order"});
  EXPECT_EQ(run("local t = {a=1, b=2, c=3} local n = 0 for k in pairs(t) do t[k] = nil t.c = nil n "
                "= n + 1 end "
                "assert(n == 2)")
                .error,
            "");
}

TEST_F(Sandbox, RandomNumbersFollowTheRunsSeed) {
  const std::string draw = "print(math.random(), math.random(1, 1000000))";
  ASSERT_EQ(run(draw).error, "");
  ASSERT_EQ(run(draw).error, "");
  ASSERT_EQ(run("math.randomseed() " + draw).error, "");
  EXPECT_EQ(said(0), said(1));
  EXPECT_EQ(said(0), said(2));
  Session other{*clock, rig, recorder, listener, 8};
  const ProtocolDescription p =
      describe("return { title = 'x', run = function() " + draw + " end }");
  engine->run(p, {}, other);
  EXPECT_NE(said(0), said(3));
}

TEST_F(Sandbox, NoAddressReachesTheRecord) {
  ASSERT_EQ(run("print({}, print, run, rig.coils, coroutine.create(print))\n"
                "print(('%s %s %5.1f %s'):format({}, print, 2, rig), vector(1, 2, 3))")
                .error,
            "");
  EXPECT_EQ(said(0), "table\tfunction\trun\tcoils\tthread");
  EXPECT_EQ(said(1), "table function   2.0 rig\t{1, 2, 3}");
  expect_all(run("print(('%p'):format({}))").error, {"p.lua:2:", "%p is not available"});
}

TEST_F(Sandbox, TimeIsTheClocks) {
  ASSERT_EQ(run("run:wait(90.5) print(os.time(), os.clock(), run:now(), os.date('%M:%S'))").error,
            "");
  EXPECT_EQ(said(), "90\t90.5\t90.5\t01:30");
}

TEST_F(Sandbox, MemoryIsCapped) {
  expect_all(run("local t = {}\nwhile true do t[#t + 1] = ('x'):rep(1000000) .. #t end").error,
             {"p.lua:3: ", "not enough memory", "256 MB"});
  EXPECT_EQ(run("local ok, why = pcall(function() local t = {}\n"
                "  while true do t[#t + 1] = ('x'):rep(1000000) .. #t end end)\n"
                "assert(not ok and why:find('not enough memory')) local again = {}\n"
                "for i = 1, 6 do again[i] = ('x'):rep(16000000) .. i end")
                .error,
            "");
}

TEST_F(Sandbox, StatesAreFreshForEachRun) {
  ASSERT_EQ(run("kept = 5").error, "");
  expect_all(run("print(kept)").error, {"kept is not defined"});
}

/// 4000 random calls of what stands in the place of Lua's own functions; a line for each 100.
constexpr const char* kLibraryCalls = R"lua(
local seed = 12345
local function any(n)
  seed = (seed * 1103515245 + 12345) % 2147483648
  return seed // 65536 % n
end
local function list()
  local t = {}
  for i = 1, any(9) do t[i] = any(5) end
  return t
end
local function shown(...)
  local words = {}
  for i = 1, select("#", ...) do
    local value = select(i, ...)
    if type(value) == "table" then
      local parts = {}
      for k = 1, 20 do parts[k] = tostring(value[k]) end
      words[i] = table.concat(parts, ",")
    else
      words[i] = tostring(value):gsub("^.-:%d+: ", ""):gsub("#%d", "#") -- 5.4.4 counts an argument of remove's wrongly
    end
  end
  return table.concat(words, "|")
end
local said = ""
for i = 1, 4000 do
  local t = list()
  local calls = {
    function() return table.insert(t, any(12) - 2, 77) end,
    function() return table.insert(t, 78) end,
    function() return table.insert(t) end,
    function() return table.remove(t, any(12) - 2) end,
    function() return table.remove(t) end,
    function() return #table.move(t, any(6), any(6), any(6) + 1) end,
    function() return #table.move(t, any(6), any(6), any(6) + 1, list()) end,
    function() table.sort(t) return #t end,
    function() return ("ab"):sub(1, any(3)):rep(any(5) - 1, any(2) == 0 and "," or nil) end,
    function() return table.move(5, 1, 2, 3) end,
    function() return ("x"):rep("y") end,
    function() return table.remove({}, any(3)) end,
    function() return utf8.len("aäß"), ("aB"):upper(), ("aB"):lower(), ("ab"):reverse(), ("ab"):byte(1, -1) end,
  }
  said = said .. shown(pcall(calls[any(#calls) + 1])) .. shown(t) .. ";"
  if i % 100 == 0 then print(said) said = "" end
end
)lua";

/// What plain Lua prints.
std::vector<std::string> lines_of_plain_lua(const char* text) {
  std::vector<std::string> lines;
  lua_State* const L = luaL_newstate();
  luaL_openlibs(L);
  lua_pushlightuserdata(L, &lines);
  lua_pushcclosure(
      L,
      [](lua_State* state) {
        static_cast<std::vector<std::string>*>(lua_touserdata(state, lua_upvalueindex(1)))
            ->emplace_back(luaL_checkstring(state, 1));
        return 0;
      },
      1);
  lua_setglobal(L, "print");
  EXPECT_EQ(luaL_dostring(L, text), LUA_OK) << lua_tostring(L, -1);
  lua_close(L);
  return lines;
}

TEST_F(Sandbox, WhatStandsInThePlaceOfLuasFunctionsDoesAsTheyDo) {
  EXPECT_EQ(run(kLibraryCalls).error, "");
  const std::vector<std::string> plain = lines_of_plain_lua(kLibraryCalls);
  ASSERT_EQ(plain.size(), 40u);
  EXPECT_EQ(listener.lines, plain);
}

TEST_F(Sandbox, TextsAreBounded) {
  expect_all(run("('x'):rep(1 << 40)").error, {"string.rep", "16 MB"});
  expect_all(run("load(('x=1 '):rep(1000000))").error, {"load", "1 MB"});
  EXPECT_EQ(
      run("assert(#('ab'):rep(3, ',') == 8 and ('x'):rep(-1) == '' and (''):rep(1 << 60) == '')")
          .error,
      "");
}

TEST_F(Sandbox, FinalizersAreRefused) {
  expect_all(run("setmetatable({}, { __gc = function() end })").error,
             {"p.lua:2:", "__gc is not available"});
}

TEST_F(Sandbox, ScriptErrorsCarryFileLineAndTrace) {
  const Ended plain = run("local function inner() error('oh no') end\ninner()");
  expect_all(plain.error, {"p.lua:2: oh no"});
  expect_all(plain.trace, {"p.lua:3:"});
  expect_all(run("error({ code = 5 })").error,
             {"p.lua:2:", "an error that is a table: {code = 5}"});
  expect_all(run("error({ message = 'said so' })").error, {"p.lua:2:", "said so"});
  expect_all(run("error(setmetatable({}, { __tostring = function() return 'my own' end }))").error,
             {"p.lua:2: my own"});
  expect_all(run("error(setmetatable({}, { __tostring = function() error('worse') end }))").error,
             {"an error that cannot be shown"});
  expect_all(run("error()").error, {"p.lua:2:", "nil"});
  expect_all(run("local function f() return f() + 1 end f()").error, {"stack overflow"});
  expect_all(run("return p.sped", "{ speed = { default = 1 } }").error,
             {"no parameter sped", "did you mean speed"});
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
