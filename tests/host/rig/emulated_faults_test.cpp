// Faults of emulated instruments: what the rig's parts allow, and when they come.
// SPDX-License-Identifier: Apache-2.0
#include "host/rig/emulated_faults.h"

#include "host/config/config.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <mutex>
#include <thread>

namespace vitreo {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;

/// Writes down what happens to it.
class FakePart final : public EmulatedPart {
 public:
  struct Log {
    std::mutex mutex;
    std::vector<std::string> lines;
    std::atomic<bool> touched{false};
  };
  FakePart(const char* type, std::string name, Log& log)
      : type_(type), name_(std::move(name)), log_(log) {}
  const char* type() const override { return type_; }
  bool touched() const override { return log_.touched; }
  void set(const Fault& fault, double by, bool on) override {
    say(fault.kind + (on ? " on " : " off ") + std::to_string(by).substr(0, 4));
  }
  void exchange(EmulatedPart& other) override {
    say("exchanged with " + dynamic_cast<FakePart&>(other).name_);
  }

 private:
  void say(const std::string& what) {
    const std::lock_guard lock(log_.mutex);
    log_.lines.push_back(name_ + " " + what);
  }
  const char* const type_;
  const std::string name_;
  Log& log_;
};

struct EmulatedFaultsTest : testing::Test {
  EmulatedFaultsTest() {
    add("stage", 0, "line");
    add("stage", 0, "motor");
    add("field_probe", 0, "line");
    add("top_camera", 0, "camera");
    for (int channel = 1; channel <= 2; ++channel) add("coils", channel, "line");
    add("coils", 0, "amplifiers");
  }
  void add(const std::string& role, int channel, const char* type) {
    const std::string name = role + (channel > 0 ? std::to_string(channel) : "") + "." + type;
    parts.push_back({role, channel, std::make_unique<FakePart>(type, name, log)});
  }
  std::string problem(const std::string& word) {
    try {
      const EmulatedFaults faults({word}, parts);
    } catch (const ConfigError& error) {
      return error.what();
    }
    return "";
  }
  std::vector<std::string> lines() {
    const std::lock_guard lock(log.mutex);
    return log.lines;
  }
  /// What has happened once there are so many lines, or after ten seconds.
  std::vector<std::string> wait_for(std::size_t count) {
    for (int i = 0; i < 10000 && lines().size() < count; ++i) std::this_thread::sleep_for(1ms);
    return lines();
  }

  FakePart::Log log;
  RoleParts parts;
};

TEST_F(EmulatedFaultsTest, WrongWordsAreRefusedNamingWhatIsKnownOfTheRole) {
  EXPECT_NE(problem("stage").find("wants ROLE:KIND"), std::string::npos);
  EXPECT_NE(problem("stage:silnt").find("did you mean \"silent\""), std::string::npos);
  const std::string frozen = problem("stage:frozen");
  EXPECT_NE(frozen.find("cannot happen to stage, only to top_camera"), std::string::npos) << frozen;
  EXPECT_NE(frozen.find("to stage there can happen silent, deaf, late"), std::string::npos)
      << frozen;
  EXPECT_NE(problem("lens_mover:silent").find("cannot happen to lens_mover"), std::string::npos);
  EXPECT_NE(problem("stage:silent:by=3s").find("there are after, lasting"), std::string::npos);
  EXPECT_NE(problem("stage:silent:channel=1").find("channel is no option"), std::string::npos)
      << "it has one line";
  EXPECT_NE(problem("coils:silent:channel=3").find("there is none of that number"),
            std::string::npos);
  EXPECT_NE(problem("coils:cut_off:channel=0").find("counts from 1"), std::string::npos);
  EXPECT_NE(problem("top_camera:late:by=2s").find("by: must be in [0, 0.9]"), std::string::npos);
  EXPECT_NE(problem("stage:late:after=-1s").find("after"), std::string::npos);
  EXPECT_NE(problem("stage:swapped").find("wants the other role"), std::string::npos);
  EXPECT_NE(problem("stage:swapped:with=stage").find("has no cable of the same kind"),
            std::string::npos);
  EXPECT_NE(problem("stage:swapped:with=top_camera").find("has no cable of the same kind"),
            std::string::npos);
  EXPECT_NE(problem("stage:power_cycled:lasting=1s").find("it is off for `by`"), std::string::npos);
  EXPECT_TRUE(lines().empty()) << "nothing has happened";
}

TEST_F(EmulatedFaultsTest, WhatHasNoDelayIsThereBeforeTheCommand) {
  const EmulatedFaults faults({"stage:late:by=20ms", "coils:cut_off:channel=2"}, parts);
  EXPECT_EQ(lines(), (std::vector<std::string>{"stage.line late on 0.02",
                                               "coils.amplifiers cut_off on 0.00"}));
}

TEST_F(EmulatedFaultsTest, TheOthersCountFromTheFirstWordToAnyInstrument) {
  const EmulatedFaults faults({"stage:silent:after=10ms,lasting=10ms"}, parts);
  std::this_thread::sleep_for(30ms);  // longer than the delay: nothing may happen
  EXPECT_TRUE(lines().empty());
  log.touched = true;
  EXPECT_EQ(wait_for(2),
            (std::vector<std::string>{"stage.line silent on 0.00", "stage.line silent off 0.00"}));
}

TEST_F(EmulatedFaultsTest, AFaultOfARoleHappensToEachOfItsPartsThatKnowsIt) {
  const EmulatedFaults faults({"coils:deaf", "coils:silent:channel=2", "stage:stuck"}, parts);
  EXPECT_EQ(lines(),
            (std::vector<std::string>{"coils1.line deaf on 0.00", "coils2.line deaf on 0.00",
                                      "coils2.line silent on 0.00", "stage.motor stuck on 0.00"}));
}

TEST_F(EmulatedFaultsTest, APowerCycleEndsByItselfAndASwapIsUndone) {
  log.touched = true;
  const EmulatedFaults faults(
      {"stage:power_cycled:by=20ms", "stage:swapped:with=field_probe,after=30ms,lasting=20ms"},
      parts);
  EXPECT_EQ(wait_for(4), (std::vector<std::string>{"stage.line power_cycled on 0.02",
                                                   "stage.line power_cycled off 0.02",
                                                   "stage.line exchanged with field_probe.line",
                                                   "stage.line exchanged with field_probe.line"}));
}

TEST_F(EmulatedFaultsTest, AreToldWithTheirTimesAndSoIsWhatNeverCame) {
  testing::internal::CaptureStderr();
  {
    const EmulatedFaults faults(
        {"stage:silent:after=10ms,lasting=10ms", "stage:deaf:after=1000s", "top_camera:frozen"},
        parts);
    log.touched = true;
    wait_for(3);
    std::this_thread::sleep_for(20ms);  // the report follows the deed
  }
  const std::string told = testing::internal::GetCapturedStderr();
  EXPECT_NE(told.find("fault begins: top_camera frozen\n"), std::string::npos) << told;
  EXPECT_NE(told.find("fault begins: stage silent for 10 ms, "), std::string::npos) << told;
  EXPECT_NE(told.find(" s after the first word, 20"), std::string::npos) << told;
  EXPECT_NE(told.find("fault is over: stage silent, "), std::string::npos) << told;
  EXPECT_NE(told.find("fault never came: stage deaf after 1000 s"), std::string::npos) << told;
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
