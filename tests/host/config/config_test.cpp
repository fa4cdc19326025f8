// SPDX-License-Identifier: Apache-2.0
#include "host/config/config.h"

#include "host/config/config_lines.h"

#include <gtest/gtest.h>

#include <limits>

namespace vitreo {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

RigDescription rig_with(ConfigTable camera) {
  return {"scripts/rigs/x.lua",
          "-- focus = 1 is said in a comment\n"
          "local units = require \"units\"\n"
          "return {\n"
          "  side_camera = { focus = 2*units.mm },\n"
          "  top_camera = {\n"
          "    note = \"focus = 7\",\n"
          "    focus = 12.3*units.mm,\n"
          "    [\"focsu\"] = 1,\n"
          "  },\n"
          "}\n",
          {{"top_camera", {std::move(camera)}}},
          {}};
}

template <class Action>
std::string error_of(Action action) {
  try {
    action();
  } catch (const ConfigError& error) {
    return error.what();
  }
  return "no error";
}

TEST(Config, ReadsWhatIsThereAndResolvesWhatIsNot) {
  const RigDescription rig =
      rig_with({{"focus", {12.3e-3}}, {"name", {std::string("top")}}, {"mirror", {true}}});
  ConfigReader root(rig);
  {
    ConfigReader camera = root.table("top_camera");
    EXPECT_EQ(camera.number("focus", 0, {0, 1, "m"}), 12.3e-3);
    EXPECT_EQ(camera.text("name", ""), "top");
    EXPECT_TRUE(camera.flag("mirror", false));
    EXPECT_EQ(camera.integer("bits", 8, 8, 16), 8);
    EXPECT_EQ(camera.vector2("center", {1, 2}, {-9, 9, "m"}), Eigen::Vector2d(1, 2));
    EXPECT_EQ(camera.choice("kind", "gray", {"gray", "color"}), "gray");
    camera.finish();
  }
  EXPECT_FALSE(root.has("side_camera"));
  EXPECT_EQ(root.table("side_camera").number("focus", 3, {0, 9, ""}), 3);
  root.finish();
  const auto expected = nlohmann::json::parse(
      R"({"top_camera": {"focus": 0.0123, "name": "top", "mirror": true, "bits": 8, "center": [1.0, 2.0], "kind": "gray"},
          "side_camera": {"focus": 3.0}})");
  EXPECT_EQ(root.resolved(), expected);
}

TEST(Config, ATypoIsNamedWithItsLineAndTheNearestKey) {
  const RigDescription rig = rig_with({{"focsu", {1.0}}});
  ConfigReader root(rig);
  ConfigReader camera = root.table("top_camera");
  camera.number("focus", 0, {0, 1, "m"});
  EXPECT_EQ(error_of([&] { camera.finish(); }),
            "scripts/rigs/x.lua:8: top_camera.focsu is not known; did you mean focus?");
}

TEST(Config, AKeyThatResemblesNothingIsJustNotKnown) {
  const RigDescription rig = rig_with({{"zoom", {1.0}}});
  ConfigReader root(rig);
  ConfigReader camera = root.table("top_camera");
  camera.number("focus", 0, {0, 1, "m"});
  EXPECT_EQ(error_of([&] { camera.finish(); }),
            "scripts/rigs/x.lua:5: top_camera.zoom is not known");
}

TEST(Config, OutOfBoundsIsSaidInPeoplesUnits) {
  const RigDescription rig = rig_with({{"focus", {3.0}}, {"field", {-1.0}}});
  ConfigReader root(rig);
  ConfigReader camera = root.table("top_camera");
  EXPECT_EQ(error_of([&] {
              camera.number("focus", 0, {1e-3, 50e-3, "m"});
            }),
            "scripts/rigs/x.lua:7: top_camera.focus is 3 m; it must be 1 mm to 50 mm");
  EXPECT_EQ(error_of([&] {
              camera.number("field", 0, {0, kInfinity, "T"});
            }),
            "scripts/rigs/x.lua:5: top_camera.field is -1 T; it must be at least 0 mT");
}

TEST(Config, TheWrongTypeIsNamed) {
  const RigDescription rig = rig_with({{"focus", {std::string("near\nby")}},
                                       {"bits", {8.5}},
                                       {"center", {ConfigList{{1.0}, {2.0}, {3.0}}}},
                                       {"axis", {ConfigList{{1.0}, {true}, {3.0}}}},
                                       {"kind", {std::string("grai")}},
                                       {"mirror", {1.0}},
                                       {"gain", {std::numeric_limits<double>::quiet_NaN()}}});
  ConfigReader root(rig);
  ConfigReader camera = root.table("top_camera");
  const std::string at = "scripts/rigs/x.lua:5: top_camera.";
  EXPECT_EQ(error_of([&] {
              camera.number("focus", 0, {0, 1, "m"});
            }),
            "scripts/rigs/x.lua:7: top_camera.focus must be a length, not the text \"near by\"");
  EXPECT_EQ(error_of([&] { camera.integer("bits", 8, 1, 16); }),
            at + "bits must be a whole number, not the number 8.5");
  EXPECT_EQ(error_of([&] {
              camera.vector2("center", {0, 0}, {0, 9, ""});
            }),
            at + "center must be a list of 2 numbers, not a list of 3");
  EXPECT_EQ(error_of([&] {
              camera.vector3("axis", {0, 0, 1}, {0, 9, ""});
            }),
            at + "axis must be a list of 3 numbers, but its number 2 is true");
  EXPECT_EQ(error_of([&] {
              camera.choice("kind", "grai", {"gray", "color"});
            }),
            at + "kind must be gray or color, not \"grai\"; did you mean gray?");
  EXPECT_EQ(error_of([&] { camera.flag("mirror", false); }),
            at + "mirror must be true or false, not the number 1");
  EXPECT_EQ(error_of([&] {
              camera.number("gain", 1, {0, 9, ""});
            }),
            at + "gain must be a number, not infinite or undefined");
  EXPECT_EQ(error_of([&] { camera.table("focus"); }),
            "scripts/rigs/x.lua:7: top_camera.focus must be a table, not the text \"near by\"");
}

TEST(Config, HugeNumbersAreNoIntegers) {
  const RigDescription rig = rig_with({{"bits", {1e300}}});
  ConfigReader root(rig);
  ConfigReader camera = root.table("top_camera");
  EXPECT_NE(error_of([&] { camera.integer("bits", 8, 1, 16); }), "no error");
}

TEST(Config, AnEmptyLuaTableIsATableAndAList) {
  const RigDescription rig = rig_with({{"list", {ConfigTable{}}}, {"table", {ConfigList{}}}});
  ConfigReader root(rig);
  ConfigReader camera = root.table("top_camera");
  EXPECT_TRUE(camera.numbers("list", {1}, {0, 9, ""}).empty());
  EXPECT_FALSE(camera.table("table").has("x"));
  EXPECT_NE(error_of([&] { camera.vector2("list", {0, 0}, {0, 9, ""}); }), "no error");
}

TEST(Config, WithoutATextThereIsNoLine) {
  const RigDescription rig{"x.lua", "", {{"a", {1.0}}}, {}};
  ConfigReader root(rig);
  EXPECT_EQ(error_of([&] { root.finish(); }), "x.lua: a is not known");
}

TEST(Nearest, FindsSlipsAndNothingElse) {
  const std::vector<std::string> words = {"focus", "field", "side_camera", "x"};
  EXPECT_EQ(nearest("focsu", words), "focus");
  EXPECT_EQ(nearest("Focus", words), "focus");
  EXPECT_EQ(nearest("sidecamera", words), "side_camera");
  EXPECT_EQ(nearest("feild", words), "field");
  EXPECT_EQ(nearest("side", words), "side_camera");
  EXPECT_EQ(nearest("banana", words), "");
  EXPECT_EQ(nearest("y", words), "");
  EXPECT_EQ(nearest("", words), "");
  EXPECT_EQ(nearest("focus", {}), "");
  EXPECT_EQ(nearest(std::string(100000, 'f'), words), "");
}

TEST(FindLine, SurvivesTextThatIsNoLua) {
  for (const char* text :
       {"", "{{{{", "}}}}", "\"", "'\\", "--", "--[[", "a =", "=", "[\"", "a.b.c = 1", "x == 1"}) {
    EXPECT_EQ(find_line(text, "focus"), 0) << text;
    find_line(text, "");
    find_line(text, "a..b");
  }
}

TEST(FindLine, TellsTablesWithTheSameKeyApart) {
  const std::string text =
      "return {\n a = { focus = 1 },\n b = {\n c = { focus = 2 },\n focus = 3 } }";
  EXPECT_EQ(find_line(text, "a.focus"), 2);
  EXPECT_EQ(find_line(text, "b.focus"), 5);
  EXPECT_EQ(find_line(text, "b.c.focus"), 4);
  EXPECT_EQ(find_line(text, "b.c.gain"), 4);
}

}  // namespace
}  // namespace vitreo
