// Rig files that compute: loops, functions, strings and tables; errors with their lines, and bounds
// for what does not end.
// SPDX-License-Identifier: Apache-2.0
#include "host/rig/rig_settings.h"
#include "tests/host/lua/interpreter/lua_bench.h"

#include <algorithm>
#include <chrono>

namespace vitreo {
namespace VITREO_TEST_FILE {

struct RigFile : LuaBench {
  RigDescription load(const std::string& text) { return engine->load_rig(write("r.lua", text)); }
  /// The error of reading it, or of checking what it says.
  std::string broken(const std::string& text) {
    try {
      check_rig(load(text));
    } catch (const std::exception& error) {
      return error.what();
    }
    return "";
  }
};

TEST_F(RigFile, ComputesTheAddressesOfEightSuppliesInALoop) {
  const RigDescription read = load(R"(
local supplies = {}
for i = 1, 8 do
  supplies[i] = ("tcp:10.0.0.%d:5025"):format(10 + i)
end
return { coils = { driver = "kepco_bop", address = table.concat(supplies, ", ") } })");
  EXPECT_EQ(check_rig(read), std::vector<std::string>{"coils"});
  EXPECT_EQ(text_of(std::get<ConfigTable>(read.table.at("coils").value), "address"),
            "tcp:10.0.0.11:5025, tcp:10.0.0.12:5025, tcp:10.0.0.13:5025, tcp:10.0.0.14:5025, "
            "tcp:10.0.0.15:5025, tcp:10.0.0.16:5025, tcp:10.0.0.17:5025, tcp:10.0.0.18:5025");
}

TEST_F(RigFile, HasFunctionsConversionsAndTheLibrariesOfStringsTablesAndNumbers) {
  const RigDescription read = load(R"lua(
local mm = require("units").mm
local function camera(number, pixel)
  assert(type(number) == "number" and pixel > 0, "a camera has a number")
  return { driver = "genicam", address = "genicam:127.0.0." .. tostring(number), pixel = pixel }
end
local rig = { title = string.upper("bench") .. select("#", 1, 2) }
for name, number in pairs { top_camera = 1, side_camera = 2 } do
  rig[name] = camera(number, number * 0.01 * mm)
end
local list = { 3, 1, 2 }
table.sort(list)
table.insert(list, (math.floor(4.7)))
rig.list, rig.hex = list, tonumber("1F", 16)
for _, value in ipairs(list) do rig.sum = (rig.sum or 0) + value end
rig.words = ("a,b"):gsub(",", ";"):find(";", 1, true)
rig.first = ("serial:/dev/ttyUSB3"):match("%d+$")
return rig)lua");
  EXPECT_EQ(text_of(read.table, "title"), "BENCH2");
  EXPECT_EQ(text_of(read.table, "first"), "3");
  EXPECT_EQ(std::get<double>(read.table.at("sum").value), 10);
  EXPECT_EQ(std::get<double>(read.table.at("words").value), 2);
  EXPECT_EQ(std::get<double>(read.table.at("hex").value), 31);
  const auto& side = std::get<ConfigTable>(read.table.at("side_camera").value);
  EXPECT_EQ(text_of(side, "address"), "genicam:127.0.0.2");
  EXPECT_DOUBLE_EQ(std::get<double>(side.at("pixel").value), 2e-5);
}

TEST_F(RigFile, ReachesNoFileNoClockNoChanceAndNoInstrument) {
  for (const char* name : {"os",
                           "io",
                           "debug",
                           "print",
                           "load",
                           "dofile",
                           "pcall",
                           "coroutine",
                           "setmetatable",
                           "rawset",
                           "rig",
                           "optics",
                           "vector",
                           "_G",
                           "_ENV.os",
                           "math.random",
                           "math.randomseed",
                           "table.move",
                           "string.dump",
                           "require 'optics'"})
    EXPECT_NE(broken("return { x = " + std::string(name) + ", a = b }"), "") << name;
  expect_all(broken("return {\n x = os.time() }"), {"r.lua:2:", "os is not defined", "computes"});
  expect_all(broken("return {\n x = tabel }"), {"r.lua:2:", "did you mean table"});
  expect_all(broken("local a\nlocal o = require 'optics'"), {"r.lua:2:", "units", "optics"});
  expect_all(broken("return { x = tostring }"), {"r.lua:1:", "x is a function"});
}

TEST_F(RigFile, TheShippedLaboratoryOfEightSuppliesIsComputedAndPassesItsCheck) {
  const RigDescription read = engine->load_rig(VITREO_SOURCE_DIR "/scripts/rigs/octomag_bop.lua");
  EXPECT_NO_THROW(check_rig(read));
  const std::string address =
      text_of(std::get<ConfigTable>(read.table.at("coils").value), "address");
  EXPECT_EQ(std::count(address.begin(), address.end(), ','), 7);
  EXPECT_TRUE(address.ends_with(", tcp:127.0.0.1:5218")) << address;
}

// Two readings of one file must give one rig: the record's is read again when a run is replayed.
TEST_F(RigFile, GivesTheSameRigAtEachReading) {
  const std::string text = R"(
local order = {}
for key in pairs { zeta = 1, alpha = 2, [3] = 3, [true] = 4, mid = 5 } do order[#order + 1] = tostring(key) end
return { title = table.concat(order, " ") .. tostring({}) .. tostring(tostring) })";
  EXPECT_EQ(text_of(load(text).table, "title"), "3 alpha mid zeta truetablefunction");
  EXPECT_EQ(text_of(load(text).table, "title"), text_of(load(text).table, "title"));
  expect_all(broken("return { x = ('%p'):format({}) }"), {"r.lua:1:", "%p"});
}

TEST_F(RigFile, ErrorsHaveTheLineAtWhichTheFileWentWrong) {
  expect_all(broken("local function limit(amperes)\n  return amperes * factor\nend\n"
                    "return { coils = {\n current_limit = limit(3) } }"),
             {"r.lua:2:", "factor"});
  expect_all(broken("for i = 1, 3 do\n  if i == 2 then error('supply ' .. i) end\nend"),
             {"r.lua:2:", "supply 2"});
  expect_all(broken("local function camera(n)\n  return {\n    driver = 'genicam',\n"
                    "    address = 'genicam:127.0.0.' .. n, width_px = 0, height_px = 4,\n"
                    "    effective_pixel = 1e-5 }\nend\nreturn { top_camera = camera(1) }"),
             {"r.lua:4:", "top_camera.width_px"});
  expect_all(broken("local t = {}\nlocal s = ('a'):find('%')"), {"r.lua:2:", "pattern"});
  expect_all(broken("local s = ('a'):gsub('a',\n function()\n return nothing end)"), {"r.lua:3:"});
  expect_all(broken("local rig = {}\nfor _, name in ipairs { 'top_camera', 'side_camera' } do\n"
                    "  rig[name] = {\n    frame_rat = 3 }\nend\nreturn rig"),
             {"r.lua:4:", "frame_rat is not known"});
}

TEST_F(RigFile, ALoopWithoutAnEndIsGivenUpWithItsLine) {
  for (const char* loop : {"while true do\n end", "repeat\n until false",
                           "for i = 1, 1e18 do\n end", "local function f()\n return f() end f()"})
    expect_all(broken("-- two\n" + std::string(loop)), {"r.lua:", "takes too long to read"});
  expect_all(broken("local x = 1\nlocal y = 2\nwhile true do x = x + y end"), {"r.lua:3:"});
  expect_all(broken("local t = {}\nfor i = 1, 1e9 do t[i] = {} end"),
             {"r.lua:2:", "not enough memory"});
}

// Inside one C function no count of instructions helps: a bound of its own does. Each of these
// would go on for years.
TEST_F(RigFile, WhatWouldNotEndInsideOneCallIsRefused) {
  const auto begun = std::chrono::steady_clock::now();
  EXPECT_EQ(text_of(load("return { title = ('').rep('', math.maxinteger) }").table, "title"), "");
  const std::string long_text = "local s = ('a'):rep(30000)\n";
  for (const char* call : {"s:find(('.-'):rep(20) .. 'b')", "s:match(('a*'):rep(9) .. 'b')",
                           "s:gsub(('a?'):rep(60) .. 'b', '')",
                           "for w in s:gmatch(('[a-c]+'):rep(8) .. 'b') do local _ = w end"})
    expect_all(broken(long_text + call), {"r.lua:2:", "pattern could take too long", "30000"});
  expect_all(broken("return {\n x = ('x'):rep(1e12) }"), {"r.lua:2:"});
  const std::string few_and_long =
      "local s = ('x'):rep(16e6)\nwhile true do local _ = s .. 'y' end";
  expect_all(broken(few_and_long), {"r.lua:2:", "takes too long to read"});
  const std::chrono::duration<double> took = std::chrono::steady_clock::now() - begun;
  EXPECT_LT(took.count(), 60) << "2 s of the thread's time are the limit; the rest is other load";
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
