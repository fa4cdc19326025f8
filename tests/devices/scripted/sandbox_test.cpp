// SPDX-License-Identifier: Apache-2.0
#include "devices/scripted/sandbox.h"

#include "devices/time/error.h"

#include <gtest/gtest.h>

namespace vitreo::scripted {
namespace VITREO_TEST_FILE {

/// What the file's error says.
std::string fault_of(const std::string& text) {
  Sandbox sandbox("pump.lua");
  try {
    sandbox.run(text);
  } catch (const ScriptFault& fault) {
    return fault.what();
  }
  return "no fault";
}

TEST(Sandbox, AnErrorHasFileAndLine) {
  EXPECT_EQ(fault_of("local a\nlocal b = a.x"),
            "pump.lua:2: attempt to index a nil value (local 'a')");
  EXPECT_NE(fault_of("return {").find("pump.lua:1: "), std::string::npos);
}

TEST(Sandbox, WhatDoesNotEndIsEndedEvenWhereTheScriptCatchesIt) {
  EXPECT_NE(fault_of("while true do end").find("pump.lua:1: it works for too long"),
            std::string::npos);
  EXPECT_NE(fault_of("while true do pcall(function() while true do end end) end")
                .find("it works for too long"),
            std::string::npos);
}

TEST(Sandbox, MemoryAndDepthHaveAnEnd) {
  EXPECT_NE(fault_of("local t = {} for i = 1, 1e9 do t[i] = ('x'):rep(1000) .. i end")
                .find("takes more memory than it may"),
            std::string::npos);
  EXPECT_NE(fault_of("local function f() return 1 + f() end f()").find("pump.lua:1: "),
            std::string::npos);
  EXPECT_NE(fault_of("return ('x'):rep(1 << 40)").find("pump.lua:1: "), std::string::npos);
}

TEST(Sandbox, TheSystemIsOutOfReach) {
  for (const char* name :
       {"io", "os", "require", "load", "dofile", "debug", "package", "coroutine", "print"})
    EXPECT_NE(fault_of(std::string("return ") + name).find(std::string(name) + " is not known"),
              std::string::npos)
        << name;
}

/// Answers each question by itself, and fails when it is asked "lost".
struct Echo : Operations {
  int perform(std::string_view operation, lua_State* L) override {
    if (operation != "ask") throw std::invalid_argument("only ask");
    const std::string text = lua_tostring(L, 1);
    if (text == "lost") throw DeviceError(DeviceErrorKind::lost, "pump", "it is gone");
    lua_pushstring(L, (text + "!").c_str());
    return 1;
  }
};

std::string call(const std::string& text) {
  Sandbox sandbox("pump.lua");
  sandbox.push_operations({"ask", "send"});
  const Reference io(sandbox.stack());
  sandbox.run("return function(io) " + text + " end");
  io.push();
  Echo echo;
  sandbox.call(1, 1, &echo);
  const char* const said = lua_tostring(sandbox.stack(), -1);
  return said == nullptr ? "nil" : said;
}

TEST(Sandbox, OperationsAreCarriedOutWhileTheScriptWaits) {
  EXPECT_EQ(call("return io:ask('a') .. io:ask('b')"), "a!b!");
  EXPECT_EQ(call("local good, what = pcall(io.ask, io, 'c') return what"), "c!");
}

TEST(Sandbox, AnOperationsErrorCanBeCaughtAndPassesUnchangedWhereItIsNot) {
  EXPECT_EQ(call("local good, e = pcall(io.ask, io, 'lost') return e.kind"), "lost");
  EXPECT_EQ(call("local good, e = pcall(io.ask, io, 'lost') return tostring(e)"),
            "pump: it is gone (lost)");
  EXPECT_THROW(call("io:ask('lost')"), DeviceError);
  EXPECT_THROW(call("local good, e = pcall(io.ask, io, 'lost') error(e)"), DeviceError);
}

TEST(Sandbox, AWrongCallOfAnOperationIsTheScriptsFault) {
  EXPECT_THROW(call("io.ask('a')"), ScriptFault);
  EXPECT_THROW(call("io:send('a')"), ScriptFault);
  EXPECT_THROW(call("table.sort({1, 2, 3}, function() return io:ask('a') end)"), ScriptFault);
  EXPECT_THROW(call("error({})"), ScriptFault);
}

TEST(Sandbox, MoreArgumentsThanAStackHoldsAreRefused) {
  EXPECT_THROW(call("local t = {} for i = 1, 240 do t[i] = 'x' end return io:ask(table.unpack(t))"
                    " .. io:ask(table.unpack(t, 1, 300))"),
               std::exception);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::scripted
