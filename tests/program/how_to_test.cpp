// docs/how-to/write_a_protocol.md, followed to the letter.
// SPDX-License-Identifier: Apache-2.0
#include "tests/program/program.h"

#include <gtest/gtest.h>

#include <vector>

namespace vitreo {
namespace VITREO_TEST_FILE {

struct Block {
  std::string head, text;  // "lua file=wobble.lua"
};

std::vector<Block> blocks_of(const std::string& page) {
  std::vector<Block> blocks;
  std::istringstream in(page);
  bool inside = false;
  for (std::string line; std::getline(in, line);) {
    if (line.starts_with("```")) {
      if (!inside) blocks.push_back({line.substr(3), ""});
      inside = !inside;
    } else if (inside) {
      blocks.back().text += line + "\n";
    }
  }
  return blocks;
}

std::string with(std::string text, const std::string& before, const std::string& added) {
  const std::size_t at = text.rfind(before);
  EXPECT_NE(at, std::string::npos) << before;
  return at == std::string::npos ? text : text.insert(at, added);
}

TEST(HowTo, WriteAProtocolWorksAsItStands) {
  const Workplace place;
  std::ostringstream page;
  page << std::ifstream(VITREO_SOURCE_DIR "/docs/how-to/write_a_protocol.md").rdbuf();
  const std::vector<Block> blocks = blocks_of(page.str());
  ASSERT_EQ(blocks.size(), 5U);
  const auto run = [&](const Block& block) {
    ASSERT_EQ(block.head, "sh");
    std::istringstream lines(block.text);
    for (std::string line; std::getline(lines, line);) {
      ASSERT_TRUE(line.starts_with("vitreo ")) << line;
      const Spoken spoken = place.vitreo(line.substr(7));
      EXPECT_EQ(spoken.exit_code, 0) << line << "\n" << spoken.out << spoken.err;
    }
  };
  ASSERT_EQ(blocks[0].head, "lua file=wobble.lua");
  std::string protocol = blocks[0].text;
  place.write("wobble.lua", protocol);
  run(blocks[1]);
  // "before the last `end` of `run`", "at the head of the file"
  protocol = "local expect = require \"analysis.expectations\"\n" +
             with(protocol, "  end,\n}", blocks[2].text);
  place.write("wobble.lua", protocol);
  const Spoken judged = place.vitreo("run wobble.lua hold=1s");
  EXPECT_EQ(judged.exit_code, 0) << judged.out << judged.err;
  EXPECT_NE(judged.out.find("verdict_better"), std::string::npos) << judged.out;
  // "before `parameters`", "at the head of the file"
  protocol =
      "local testing = require \"testing\"\n" + with(protocol, "  parameters = {", blocks[3].text);
  place.write("wobble.lua", protocol);
  run(blocks[4]);
}

TEST(TestCommand, AProtocolThatLeavesItsTestsIsToldWhere) {
  const Workplace place;
  place.write("slow.lua",
              "local testing = require 'testing'\n"
              "return { title = 'Slow', needs = {}, tests = { testing.test_run { results = { a = { "
              "2, 3 } } },\n"
              "  testing.test_fail { says = 'nothing' }, testing.test_stop { times = 3 } },\n"
              "  run = function(rig, p, run) run:wait(1) run:result('a', 1) end }");
  const Spoken spoken = place.vitreo("test slow.lua");
  EXPECT_EQ(spoken.exit_code, 1);
  EXPECT_NE(spoken.out.find("FAILED run: a is 1, wanted 2 to 3"), std::string::npos) << spoken.out;
  EXPECT_NE(spoken.out.find("FAILED fail: it completed"), std::string::npos) << spoken.out;
  EXPECT_NE(spoken.out.find("passed stop 3 of 3"), std::string::npos) << spoken.out;
  EXPECT_NE(spoken.out.find("3 of 5 runs passed"), std::string::npos) << spoken.out;
}

// The host cannot reach the amplifier, so it holds its currents: that must be told beside the
// outcome.
TEST(TestCommand, CoilsThatStayEnergizedAreToldOfARunThatFailsToo) {
  const Workplace place;
  place.write("pose.lua",
              "return { title = 'by the pose sensor', coils = {}, pose_sensor = {}, sample = {} }");
  place.write("held.lua",
              "return { title = 'Held', needs = { 'coils' }, rig = 'pose.lua',\n"
              "  tests = { { test = 'run', fault = 'coils:unplugged:after=1s' } },\n"
              "  run = function(rig, p, run)\n"
              "    local servo <close> = rig:servo { feedback = 'pose_sensor' }\n"
              "    servo:hold { 0, 0, 0 }\n"
              "    rig.sample:insert_robot { 0, 0, 0 }\n"
              "    run:wait(2)\n"
              "  end }");
  const Spoken spoken = place.vitreo("test held.lua");
  EXPECT_EQ(spoken.exit_code, 1) << spoken.out << spoken.err;
  EXPECT_NE(spoken.out.find("FAILED run: the coils are energized after the end; aborted: "),
            std::string::npos)
      << spoken.out << spoken.err;
}

TEST(TestCommand, WithoutTestsItIsRunAndStoppedAndWrongTestsAreRefused) {
  const Workplace place;
  const Spoken usual = place.vitreo("test hello_rig --stops 4");
  EXPECT_EQ(usual.exit_code, 0) << usual.out << usual.err;
  EXPECT_NE(usual.out.find("5 of 5 runs passed"), std::string::npos) << usual.out;
  place.write("wrong.lua",
              "return { title = 'x', tests = { { test = 'stopp' } }, run = function() end }");
  const Spoken wrong = place.vitreo("test wrong.lua");
  EXPECT_EQ(wrong.exit_code, 2);
  EXPECT_NE(wrong.err.find("tests.1.test is run, fail or stop"), std::string::npos) << wrong.err;
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
