// SPDX-License-Identifier: Apache-2.0
#include "tests/host/lua/interpreter/lua_bench.h"

namespace vitreo {
namespace VITREO_TEST_FILE {

using Describe = LuaBench;

std::string error_of(const std::function<void()>& body) {
  try {
    body();
  } catch (const std::exception& error) {
    return error.what();
  }
  return "";
}

TEST_F(Describe, AProtocolDescribesItself) {
  const ProtocolDescription p = describe(R"(-- p: what it is for
-- in two lines.
-- SPDX-License-Identifier: Apache-2.0
local units = require "units"
return {
  title = "A test",
  needs = { "coils", "top_camera" },
  parameters = {
    speed = { unit = "mm/s", default = 0.5 * units.mm_per_s, min = 0.1 * units.mm_per_s, max = 1e-3, help = "how fast" },
    laps = { default = 2, min = 1, max = 9, integer = true },
    mode = { choices = { "one", "two" }, default = "two" },
    quiet = { default = false },
    name = { default = "x" },
  },
  run = function() end,
})");
  EXPECT_EQ(p.name, "p");
  EXPECT_EQ(p.title, "A test");
  EXPECT_EQ(p.about, "p: what it is for\nin two lines.");
  EXPECT_EQ(p.needs, (std::vector<std::string>{"coils", "top_camera"}));
  ASSERT_EQ(p.parameters.size(), 5u);
  EXPECT_EQ(p.parameters[0].name, "laps");
  EXPECT_EQ(p.parameters[0].kind, ParameterKind::integer);
  EXPECT_EQ(p.parameters[1].choices.size(), 2u);
  EXPECT_EQ(p.parameters[3].kind, ParameterKind::flag);
  EXPECT_EQ(p.parameters[4].unit, "mm/s");
  EXPECT_DOUBLE_EQ(std::get<double>(p.parameters[4].fallback), 0.5e-3);
  EXPECT_DOUBLE_EQ(p.parameters[4].min, 0.1e-3);
}

TEST_F(Describe, WhatIsWrongIsOneLineWithFileAndLine) {
  const auto broken = [&](const std::string& text) { return error_of([&] { describe(text); }); };
  expect_all(broken("return {\n title = 'x',\n run = funktion() end }"),
             {"p.lua:3:", "near 'end'"});
  expect_all(broken("return {\n title = 'x',\n neds = {},\n run = function() end }"),
             {"p.lua:3:", "neds is not known", "did you mean needs"});
  expect_all(broken("return {\n run = function() end }"),
             {"p.lua:", "title wants a string, got nothing"});
  expect_all(broken("return { title = 'x' }"), {"run wants a function"});
  expect_all(broken("return 5"), {"p.lua", "returns a table", "a number"});
  expect_all(broken("return { title = 'x', needs = {'top_camra'}, run = print }"),
             {"top_camra", "did you mean top_camera"});
  expect_all(broken("\nlocal x = nil + 1"), {"p.lua:2:", "arithmetic on a nil value"});
  expect_all(broken("return { title = 'x', run = prnt }"),
             {"p.lua:1:", "prnt is not defined", "did you mean print"});
  expect_all(error_of([&] { engine->describe((folder.path() / "nowhere.lua").string()); }),
             {"nowhere.lua", "no such file"});
  expect_all(error_of([&] { engine->describe(folder.path().string()); }), {"is a folder"});
  expect_all(broken("\x1bLua rubbish"), {"p.lua", "not a text file"});
  expect_all(broken("while true do end"), {"p.lua", "too long to read"});
}

TEST_F(Describe, WrongParametersNameTheParameterAndItsLine) {
  const auto broken = [&](const std::string& parameter) {
    return error_of([&] {
      describe("return {\n title = 'x',\n parameters = {\n  speed = " + parameter +
               " },\n run = print }");
    });
  };
  expect_all(broken("{ default = 1, mni = 0 }"),
             {"p.lua:4:", "parameters.speed.mni", "did you mean min"});
  expect_all(broken("{ min = 0 }"), {"speed.default is missing"});
  expect_all(broken("{ default = 5, max = 2 }"), {"default (5) is outside of its own range"});
  expect_all(broken("{ default = 5, min = 9, max = 2 }"), {"min (9) is above max (2)"});
  expect_all(broken("{ default = 1, unit = 'mm/ss' }"), {"'mm/ss' is not a unit"});
  expect_all(broken("{ default = 'c', choices = { 'a', 'b' } }"), {"'c' is not among its choices"});
  expect_all(broken("{ default = 1.5, integer = true }"), {"whole number"});
  expect_all(broken("{ default = 0/0 }"), {"wants a number"});
  expect_all(broken("{ default = true, min = 0 }"), {"min is only for numbers"});
  expect_all(broken("7"), {"parameters.speed wants a table"});
}

TEST_F(Describe, ReadingAFileReachesNoRigAndNoClock) {
  expect_all(error_of([&] { describe("return { title = os.time(), run = print }"); }),
             {"only being read"});
  expect_all(error_of([&] { describe("local r = rig\nreturn {}"); }),
             {"p.lua:1:", "rig is not defined"});
}

TEST_F(Describe, ARigFileIsPlainData) {
  const RigDescription rig_file = engine->load_rig(write("r.lua", R"(local units = require "units"
return {
  title = "bench",
  top_camera = { seed = 3, offset = { 1, 2, 3*units.mm }, quick = true },
  empty = {},
})"));
  EXPECT_EQ(std::get<std::string>(rig_file.table.at("title").value), "bench");
  const auto& camera_table = std::get<ConfigTable>(rig_file.table.at("top_camera").value);
  EXPECT_EQ(std::get<ConfigList>(camera_table.at("offset").value).size(), 3u);
  EXPECT_DOUBLE_EQ(std::get<double>(std::get<ConfigList>(camera_table.at("offset").value)[2].value),
                   3e-3);
  EXPECT_TRUE(std::get<bool>(camera_table.at("quick").value));
  EXPECT_TRUE(std::get<ConfigTable>(rig_file.table.at("empty").value).empty());
}

TEST_F(Describe, ARigFileSaysOnlyWhatDiffersFromTheOneItBuildsOn) {
  write("bench.lua", R"(return { title = "bench",
  top_camera = { driver = "simulated", width_px = 640, sensor = { noise = 1, gain = 2 }, fit = { 1, 2 } },
  stage = { driver = "zaber", device = 3 }, lamp = { driver = "led" }, truth = { moment = 0.05, flag = true } })");
  write("middle.lua",
        "return { base = 'bench', title = 'middle', lamp = false, truth = { moment = false, flag = "
        "false } }");
  const RigDescription whole = engine->load_rig(write("r.lua", R"(return { base = "middle",
  title = "r",
  top_camera = { width_px = 320, sensor = { gain = 5 }, fit = { 7 } }, stage = { driver = "mp285", speed = 1 } })"));
  const auto table = [](const ConfigTable& in, const char* key) {
    return std::get<ConfigTable>(in.at(key).value);
  };
  EXPECT_EQ(std::get<std::string>(whole.table.at("title").value), "r");
  EXPECT_FALSE(whole.table.contains("base"));
  const ConfigTable top = table(whole.table, "top_camera"), sensor = table(top, "sensor");
  EXPECT_EQ(std::get<double>(top.at("width_px").value), 320);
  EXPECT_EQ(std::get<std::string>(top.at("driver").value), "simulated");
  EXPECT_EQ(std::get<double>(sensor.at("noise").value), 1);
  EXPECT_EQ(std::get<double>(sensor.at("gain").value), 5);
  EXPECT_EQ(std::get<ConfigList>(top.at("fit").value).size(), 1u);  // a list is taken whole
  EXPECT_FALSE(table(whole.table, "stage").contains("device"))
      << "of one driver's settings the next knows nothing";
  EXPECT_FALSE(whole.table.contains("lamp")) << "false takes a role away";
  EXPECT_FALSE(table(whole.table, "truth").contains("moment"))
      << "and a number, whose default counts again";
  EXPECT_FALSE(std::get<bool>(table(whole.table, "truth").at("flag").value))
      << "a flag is only a flag";
  ASSERT_EQ(whole.bases.size(), 2u);
  EXPECT_NE(whole.bases[0].file.find("middle.lua"), std::string::npos);
  EXPECT_NE(whole.bases[1].text.find("bench"), std::string::npos);
  EXPECT_NE(whole.source_of("top_camera.sensor.noise").file.find("bench.lua"), std::string::npos);
  EXPECT_NE(whole.source_of("top_camera.sensor.gain").file.find("r.lua"), std::string::npos);
  EXPECT_NE(whole.source_of("truth.flag").file.find("middle.lua"), std::string::npos);
  EXPECT_NE(whole.source_of("stage.device").file.find("r.lua"), std::string::npos);
}

TEST_F(Describe, AnErrorInARigFileNamesTheFileAndLineInWhichTheKeyStands) {
  write("bench.lua", "return {\n  top_camera = {\n    focsu = 1,\n  },\n}");
  const RigDescription whole = engine->load_rig(
      write("r.lua", "return { base = 'bench', top_camera = { width_px = true } }"));
  ConfigReader reader(whole);
  ConfigReader top = reader.table("top_camera");
  expect_all(error_of([&] { top.integer("width_px", 1, 1, 9); }),
             {"r.lua:1:", "top_camera.width_px must be"});
  top.flag("width_px", false);
  top.number("focus", 0, {0, 1, "m"});
  expect_all(error_of([&] { top.finish(); }), {"bench.lua:3:", "focsu", "did you mean focus"});
}

TEST_F(Describe, WhatARigFileBuildsOnIsFoundOrRefusedByName) {
  const auto broken = [&](const std::string& text) {
    return error_of([&] { engine->load_rig(write("r.lua", text)); });
  };
  std::filesystem::create_directories(folder.path() / "lib" / "rigs");
  write("lib/rigs/house.lua", "return { coils = {} }");
  EXPECT_EQ(engine->load_rig(write("r.lua", "return { base = 'house' }")).table.count("coils"), 1u)
      << "the program's own are found from anywhere";
  EXPECT_EQ(engine->load_rig(write("house.lua", "return { base = 'house' }")).table.count("coils"),
            1u)
      << "also from a file of that name";
  expect_all(broken("return {\n base = 'huose' }"), {"r.lua:2:", "huose", "did you mean house"});
  expect_all(broken("return { base = 'not/there.lua' }"), {"r.lua:1:", "not there", "there.lua"});
  expect_all(broken("return { base = 3 }"), {"r.lua:1:", "base wants a rig's name"});
  expect_all(broken("return { base = '' }"), {"base wants a rig's name"});
  write("a.lua", "return { base = 'b' }");
  write("b.lua", "return { base = 'r' }");
  expect_all(broken("return { base = 'a' }"), {"b.lua:1:", "base goes in a circle", "r.lua"});
  expect_all(broken("return { base = 'r.lua' }"), {"circle"});
  write("a.lua", "return { x = print }");
  expect_all(broken("return { base = 'a' }"), {"a.lua:1:"});
}

TEST_F(Describe, ARigFileHoldsConstantsOnly) {
  const auto broken = [&](const std::string& text) {
    return error_of([&] { engine->load_rig(write("r.lua", text)); });
  };
  expect_all(broken("return {\n f = function() end }"), {"r.lua:2:", "f is a function"});
  expect_all(broken("return { a = { 1, x = 2 } }"), {"r.lua:1:", "a mixes"});
  expect_all(broken("return { a = 1/0 }"), {"a is not a finite number"});
  expect_all(broken("local t = {} t.t = t return t"), {"without end"});
  expect_all(broken("return {\n a = os.time() }"), {"r.lua:2:", "os is not defined"});
  expect_all(broken("return { a = print }"), {"print is not defined"});
  expect_all(broken("return {"), {"r.lua:1:"});
  expect_all(broken("return 3"), {"returns a table"});
  expect_all(broken("while true do end"), {"too long"});
  expect_all(broken("return { a = math.random() }"), {"r.lua:1:"});
}

ProtocolDescription square() {
  ProtocolDescription p;
  p.name = "square";
  p.parameters = {
      {"laps", "", ParameterKind::integer, "", 1.0, 1, 9, {}},
      {"mode", "", ParameterKind::choice, "", std::string("fast"), 0, 0, {"fast", "slow"}},
      {"quiet", "", ParameterKind::flag, "", false, 0, 0, {}},
      {"speed", "", ParameterKind::number, "mm/s", 0.5e-3, 0.1e-3, 2e-3, {}}};
  return p;
}

TEST(Arguments, ValuesAreReadAsPeopleWriteThem) {
  const auto values = check_arguments(square(), {"speed=700um/s", "laps=3", "quiet=yes"});
  EXPECT_DOUBLE_EQ(std::get<double>(values.at("speed")), 0.7e-3);
  EXPECT_EQ(std::get<double>(values.at("laps")), 3);
  EXPECT_TRUE(std::get<bool>(values.at("quiet")));
  EXPECT_EQ(std::get<std::string>(values.at("mode")), "fast");
}

TEST(Arguments, WrongOnesNameTheParameterAndWhatItWants) {
  const auto broken = [](const std::string& word) {
    return error_of([&] { check_arguments(square(), {word}); });
  };
  expect_all(broken("speed=5um"), {"speed: wants a speed", "5um is a length"});
  expect_all(broken("speed=1"), {"speed: wants a speed", "no unit", "1mm/s"});
  expect_all(broken("speed=9mm/s"), {"speed: wants", "2 mm/s", "got 9mm/s"});
  expect_all(broken("speed=quick"), {"speed: wants a speed", "such as speed=0.5mm/s"});
  expect_all(broken("sped=1mm/s"), {"sped", "not a parameter of square", "did you mean speed"});
  expect_all(broken("laps=1.5"), {"laps: wants a whole number"});
  expect_all(broken("laps=2mm"), {"laps: wants a plain number"});
  expect_all(broken("laps=10"), {"laps: wants 1 to 9"});
  expect_all(broken("laps=nan"), {"laps: wants"});
  expect_all(broken("mode=fats"), {"mode: wants one of fast, slow", "did you mean fast"});
  expect_all(broken("quiet=maybe"), {"quiet: wants true or false"});
  expect_all(broken("speed"), {"name=value"});
  expect_all(error_of([] {
               check_arguments(square(), {"laps=1", "laps=2"});
             }),
             {"laps: is given twice"});
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
