// The prompt while it stands idle, a loop holding, and something fails that no statement asks for.
// SPDX-License-Identifier: Apache-2.0
#include "tests/program/program.h"
#include "tests/program/terminal.h"

#include <gtest/gtest.h>

#include <chrono>
#include <string>

namespace vitreo {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;

/// A prompt in real time in which a fault begins after 15 s: a busy machine takes a while to hold.
struct PromptFaults : ::testing::Test {
  void hold(Terminal& terminal) const {
    ASSERT_TRUE(terminal.prompts()) << terminal.unseen();
    for (const char* line :
         {"function flows() local t = 0 for _, i in ipairs(rig.coils:currents()) do "
          "t = t + math.abs(i) end print('cur' .. 'rents ' .. (t == 0 and 'zero' or 'flowing')) "
          "end",
          "rig.sample:insert_robot(vector(0, 0, 0))",
          "servo = rig:servo { feedback = 'pose_sensor' } servo:wait_until_tracked()", "flows()"}) {
      terminal.type(std::string(line) + "\r");
      ASSERT_TRUE(terminal.prompts()) << line << ": " << terminal.unseen();
    }
    const bool flows = terminal.screen().find("currents flowing") != std::string::npos;
    ASSERT_TRUE(flows || tripped(terminal)) << terminal.screen();
  }
  /// A machine that is too busy for a loop has it tripped before the fault comes, rightly.
  static bool tripped(const Terminal& terminal) {
    return terminal.screen().find("not moved for") != std::string::npos;
  }
  static std::string fault(const std::string& word) {
    return "--real-time --fault " + word + ":after=15s";
  }
  const Workplace place_;
};

TEST_F(PromptFaults, ALoopThatEndsByItselfIsToldOfAtOnce) {
  Terminal terminal(place_.folder(), fault("pose_sensor:frozen"), 300);
  ASSERT_NO_FATAL_FAILURE(hold(terminal));
  // Nothing is typed.
  const bool told = terminal.sees("ALARM high: servo: the loop has ended: ", 30s);
  if (!told && tripped(terminal)) GTEST_SKIP() << "the machine was too busy for a loop";
  EXPECT_TRUE(told) << terminal.unseen();
  EXPECT_TRUE(terminal.sees("; the coils are at zero")) << terminal.unseen();
  terminal.type("flows()\r");
  EXPECT_TRUE(terminal.sees("currents zero")) << terminal.unseen();
  terminal.type("exit\r");
  EXPECT_EQ(terminal.end(), 0) << terminal.unseen();
  const std::string json = place_.vitreo("show last --json").out;
  EXPECT_NE(json.find("servo: the loop has ended: "), std::string::npos) << "it is in the record";
}

TEST_F(PromptFaults, WithoutARecordNothingIsEnergized) {
  Terminal terminal(place_.folder(), fault("disk:full"), 300);
  ASSERT_NO_FATAL_FAILURE(hold(terminal));
  EXPECT_TRUE(terminal.sees("stopped because recording failed: ", 30s)) << terminal.unseen();
  EXPECT_TRUE(terminal.sees("; the devices are safe")) << terminal.unseen();
  terminal.type("rig.coils:enable()\r");
  EXPECT_TRUE(terminal.sees("nothing is recorded any more")) << terminal.unseen();
  terminal.type("rig.coils:set_currents({ 1, 0, 0, 0, 0, 0, 0, 0 }, { hold = 60 })\r");
  EXPECT_TRUE(terminal.sees("error: ")) << terminal.unseen();
  terminal.type("flows()\r");
  EXPECT_TRUE(terminal.sees("currents zero")) << terminal.unseen();
  terminal.type("exit\r");
  EXPECT_EQ(terminal.end(), 4) << terminal.unseen();
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
