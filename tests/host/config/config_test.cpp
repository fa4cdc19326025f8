// SPDX-License-Identifier: Apache-2.0
#include "host/config/config.h"

#include "host/config/config_lines.h"

#include <gtest/gtest.h>

#include <limits>

namespace vitreo {
namespace VITREO_TEST_FILE {

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
            "scripts/rigs/x.lua:7: top_camera.focus is 3 m; it must be 1 to 50 mm");
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

TEST(Config, ALongTextIsCutBetweenItsCharacters) {
  const RigDescription rig = rig_with({{"bits", {std::string(39, 'x') + "\u00b5m"}}});
  ConfigReader root(rig);
  ConfigReader camera = root.table("top_camera");
  EXPECT_EQ(error_of([&] { camera.integer("bits", 8, 1, 16); }),
            "scripts/rigs/x.lua:5: top_camera.bits must be a whole number, not the text \"" +
                std::string(39, 'x') + "...\"");
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
  EXPECT_TRUE(camera.texts("list").empty());
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

TEST(FindLine, PassesOverLongStrings) {
  const std::string text =
      "return {\n title = [[\n  focsu = 3,\n top_camera = { focsu = 3 },\n]],\n" /* lines 1 to 5 */
      " note = [==[ ]] focsu = 3, ]=]\n focsu = 4 ]==],\n\n"                     /* to 8 */
      " top_camera = {\n  driver = 'x',\n  focsu = 3,\n },\n}\n";
  EXPECT_EQ(find_line(text, "top_camera.focsu"), 11);
  EXPECT_EQ(find_line(text, "top_camera"), 9);
  EXPECT_EQ(find_line(text, "note"), 6);
  EXPECT_EQ(find_line(text, "focsu"), 0);
}

TEST(FindLine, PassesOverComments) {
  const std::string text =
      "-- focsu = 1 } {\n--[==[ focsu = 2\n ]] }\n]==] return {\n"
      " a = { --[[ focsu = 1, } ]] gain = 1, -- }\n --\n focsu = 3 },\n}";
  EXPECT_EQ(find_line(text, "a.focsu"), 7);
  EXPECT_EQ(find_line(text, "a.gain"), 5);
}

TEST(FindLine, PassesOverStringsWithEscapes) {
  const std::string text =
      "return {\n s = \"\\\" focsu = 1, }\\\\\",\n t = 'it\\'s { focsu = 2',\n"
      " u = \"over\\\nlines focsu = 3\\z\n   \\065\\x41\\u{41}\",\n focsu = 4 }";
  EXPECT_EQ(find_line(text, "focsu"), 7);
  EXPECT_EQ(find_line(text, "u"), 4);
}

TEST(FindLine, KnowsKeysInBrackets) {
  const std::string text =
      "return {\n [\"a\"] = {\n [ 'fo\\x63\\115u' ] = 1,\n [ [[gain]] ] = 2,\n [3] = 4,\n"
      " [1 + 1] = 5 } }";
  EXPECT_EQ(find_line(text, "a.focsu"), 3);
  EXPECT_EQ(find_line(text, "a.gain"), 4);
  EXPECT_EQ(find_line(text, "a.3"), 5);
}

TEST(FindLine, CountsTheItemsOfLists) {
  const std::string text =
      "return { list = {\n { x = 1 },\n 7; f(1, 2),\n { y = 2,\n x = 3 } }, x = 4 }";
  EXPECT_EQ(find_line(text, "list.1.x"), 2);
  EXPECT_EQ(find_line(text, "list.2"), 3);
  EXPECT_EQ(find_line(text, "list.3"), 3);
  EXPECT_EQ(find_line(text, "list.4.x"), 5);
}

TEST(FindLine, OfAKeyThatIsMissingGivesItsTableAndNotAnotherTablesKey) {
  const std::string text = "return {\n a = { focus = 1 },\n b = {\n gain = 2 } }";
  EXPECT_EQ(find_line(text, "b.focus"), 3);
  EXPECT_EQ(find_line(text, "focus"), 0);
}

TEST(FindLine, TakesComparisonsForValues) {
  const std::string text =
      "return { a = x == 1, b = y ~= 2 or z <= 3,\n c = { d = a >= 1,\n y = 5 } }";
  EXPECT_EQ(find_line(text, "c.y"), 3);
  EXPECT_EQ(find_line(text, "y"), 0);
}

TEST(FindLine, PassesOverTheBodiesOfFunctions) {
  const std::string text =
      "return {\n run = function(rig, p)\n  title, needs = 1, 2\n  if p then title = { title = 3 } "
      "end\n"
      "  for i = 1, 2 do repeat title = i until i > 1 end\n  return { title = 4 }\n end,\n"
      " title = 5 }";
  EXPECT_EQ(find_line(text, "title"), 8);
}

TEST(FindLine, FollowsVariablesAndAssignments) {
  const std::string text =
      "local top <const> = {\n focsu = 1 }\nlocal rig = { top_camera = top,\n side = {} }\n"
      "rig.side.gain = 2\nrig['coils'] = {\n limit = 3 }\nreturn rig\n";
  EXPECT_EQ(find_line(text, "top_camera.focsu"), 2);
  EXPECT_EQ(find_line(text, "top_camera.nothing"), 3);
  EXPECT_EQ(find_line(text, "side.gain"), 5);
  EXPECT_EQ(find_line(text, "coils.limit"), 7);
}

TEST(FindLine, LooksIntoCallsAndElsewhereWhereATableIsComputed) {
  const std::string text =
      "local function camera(t)\n t.focsu = 3\n return t\nend\n"
      "return { a = camera {\n gain = 1 },\n b = camera(x) }";
  EXPECT_EQ(find_line(text, "a.gain"), 6);
  EXPECT_EQ(find_line(text, "b.focsu"), 2);
  EXPECT_EQ(find_line(text, "b.other"), 7);
}

TEST(FindLine, FollowsWhatAFunctionOfTheTextReturns) {
  const std::string text =
      "local function camera(n)\n return { driver = 'genicam',\n adress = n }\nend\n"  // 1
                                                                                       // to
                                                                                       // 4
      "local function stage(n)\n local t = { driver = 'zaber' }\n t.adress = n\n return "
      "t\nend\n"                                                                // 9
      "local lamp = function()\n local t = {\n adress = 1 }\n return t\nend\n"  // 14
      "return { top = camera(1), stage = stage 'x',\n turn = stage { 'y' }, lamp = "
      "lamp(),\n"  // 16
      " other = elsewhere(3) }";
  EXPECT_EQ(find_line(text, "top.adress"), 3);
  EXPECT_EQ(find_line(text, "stage.driver"), 6);
  EXPECT_EQ(find_line(text, "stage.adress"), 7) << "a call by a string";
  EXPECT_EQ(find_line(text, "turn.adress"), 7);
  EXPECT_EQ(find_line(text, "lamp.adress"), 12) << "another function's t";
  EXPECT_EQ(find_line(text, "top.missing"), 15);
  EXPECT_EQ(find_line(text, "other.nothing"), 17);
}

TEST(FindLine, FollowsKeysThatALoopComputes) {
  const std::string text =
      "local rig = { title = 'x' }\nlocal bodies = {}\n"                                    // 1, 2
      "for i = 1, 3 do\n bodies[#bodies + 1] = {\n shape = 'disc',\n semi_axs = i } end\n"  // 3 to
                                                                                            // 6
      "for _, name in ipairs { 'top_camera', 'side_camera' } do\n"                          // 7
      " rig[name] = { driver = 'genicam',\n adress = name }\nend\n"        // 8 to 10
      "rig.truth = { bodies = bodies,\n first = bodies[1] }\nreturn rig";  // 11
  EXPECT_EQ(find_line(text, "truth.bodies.2.semi_axs"), 6);
  EXPECT_EQ(find_line(text, "truth.first.shape"), 5);
  EXPECT_EQ(find_line(text, "side_camera.adress"), 9);
  EXPECT_EQ(find_line(text, "side_camera"), 8);
  EXPECT_EQ(find_line(text, "title"), 1) << "a key that is written as it is counts first";
}

TEST(FindLine, CountsLinesAsLuaDoesAndTakesTheLastOfTwo) {
  EXPECT_EQ(find_line("return {\r\n a = 1,\r\n b = 2 }", "b"), 3);
  EXPECT_EQ(find_line("return {\r a = [[\r\r]],\r b = 2 }", "b"), 5);
  EXPECT_EQ(find_line("return { a = 1,\n a = 2 }", "a"), 2);
  EXPECT_EQ(find_line("return { x = 0x1p4, y = 3e-2,\n z = 1..'', w = 4 }", "w"), 2);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
