// Whole runs on the simulated rig: however one ends, the emulated outputs are at zero and the end
// record is true.
// SPDX-License-Identifier: Apache-2.0
#include "host/engine/run_engine.h"

#include "devices/time/error.h"
#include "host/lua/engine/engine.h"
#include "tests/host/rig/fake_rig.h"

#include <gtest/gtest.h>

#include <fstream>
#include <signal.h>
#include <sstream>

namespace vitreo {
namespace VITREO_TEST_FILE {

constexpr double kZeroVolts = 2e-4;  // half a count of the converter

struct RunEngineTest : testing::Test {
  /// Runs `body`, the inside of a protocol's run function, on the shipped simulated rig.
  RunResult run(const std::string& body, const Inspect& and_then = nullptr) {
    const std::string file = (folder.path() / "protocol.lua").string();
    std::ofstream(file) << "local units = require 'units'\nlocal s, mm = units.s, units.mm\n"
                        << "return { title = 'test', needs = { 'top_camera', 'coils', 'sample' }, "
                           "run = function(rig, p, run)\n"
                        << body << "\nend }";
    RunRequest request;
    request.what.protocol_file = file;
    request.where.rig_file = rig_file;
    request.where.out = (folder.path() / "runs").string();
    return run_protocol(*engine, request, listener, [&](const Recorder& recorder, OpenRig& rig) {
      inspected = true;
      for (const double volts : rig.laboratory()->coil_outputs().outputs())
        EXPECT_NEAR(volts, 0, kZeroVolts);
      ASSERT_NE(recorder.end(), nullptr);
      outcome_in_record = recorder.end()->outcome;
      if (and_then) and_then(recorder, rig);
    });
  }
  void TearDown() override { EXPECT_TRUE(inspected); }

  TemporaryFolder folder;
  std::string rig_file = VITREO_SOURCE_DIR "/scripts/rigs/simulated.lua";
  SilentListener listener;
  std::unique_ptr<ScriptEngine> engine = make_lua_engine({VITREO_SOURCE_DIR "/scripts"});
  bool inspected = false;
  Outcome outcome_in_record = Outcome::completed;
};

/// A script whose servo holds the robot, and then `what`.
std::string held_and_then(const std::string& what) {
  return "local background = rig:learn_background { frames = 4 }\n"
         "local servo = rig:servo { background = background }\n"
         "servo:hold { 0, 0, 0 }\n"
         "rig.sample:insert_robot { 0, 0, 0 }\n"
         "servo:wait_until_tracked()\n"
         "run:wait(0.5*s)\n" +
         what;
}

TEST_F(RunEngineTest, ANormalEndLeavesZeroThoughTheScriptForgotToClose) {
  const RunResult result =
      run(held_and_then("run:result('answer', 42, '')"), [](const Recorder& recorder, OpenRig&) {
        const Stream& currents = *recorder.stream("currents");
        double most = 0;
        for (const double current : currents.values) most = std::max(most, std::abs(current));
        EXPECT_GT(most, 0.5) << "A: they did flow";
      });
  EXPECT_EQ(result.outcome, Outcome::completed) << result.reason;
}

TEST_F(RunEngineTest, AnErrorInTheScriptLeavesZero) {
  const RunResult result = run(held_and_then("error('on purpose')"));
  EXPECT_EQ(result.outcome, Outcome::failed);
  EXPECT_EQ(result.exit_code, ExitCode::script_error);
  EXPECT_EQ(outcome_in_record, Outcome::failed);
  EXPECT_NE(result.reason.find("protocol.lua:10: on purpose"), std::string::npos) << result.reason;
}

/// The last event of what is known of the coils at their rest.
std::string rest_in(const Recorder& recorder) { return coil_rest_text(recorder.data()); }

TEST_F(RunEngineTest, TheRecordSaysWhatTheCoilsCarryAtItsEnd) {
  std::string text, end;
  run("rig.coils:set_currents { 1, 1, 1, 1, 1, 1, 1, 1 }\nrun:wait(0.2*s)",
      [&](const Recorder& recorder, OpenRig&) {
        text = rest_in(recorder);
        end = summary(recorder.data()).at("coils_at_end");
        std::ostringstream report;
        report << std::ifstream(recorder.folder() / "report.html").rdbuf();
        EXPECT_NE(report.str().find("At the end <b>" + text), std::string::npos);
        EXPECT_EQ(recorder.stream(kCoilReadBack), nullptr) << "nothing can be read back";
      });
  EXPECT_EQ(text.find("coils set to 0 A at "), 0U) << text;
  EXPECT_NE(text.find(" s; this rig has no read-back"), std::string::npos) << text;
  EXPECT_EQ(end, text);
}

TEST_F(RunEngineTest, TheRecordSaysWhatACurrentSensorReadBackAtItsEnd) {
  std::ofstream(folder.path() / "rig.lua") << "return { base = '" VITREO_SOURCE_DIR
                                              "/scripts/rigs/simulated.lua',\n"
                                              "current_sensor = { driver = 'simulated' } }";
  rig_file = (folder.path() / "rig.lua").string();
  std::string text;
  run("rig.coils:set_currents { 1, 1, 1, 1, 1, 1, 1, 1 }\nrun:wait(0.5*s)\nerror('on purpose')",
      [&](const Recorder& recorder, OpenRig&) {
        text = rest_in(recorder);
        const Stream* const back = recorder.stream(kCoilReadBack);
        ASSERT_NE(back, nullptr);
        EXPECT_EQ(back->info.channels.size(), 8U);
        for (std::size_t coil = 0; coil < 8; ++coil)
          EXPECT_NEAR(back->at(back->times.size() - 1, coil), 0, kZeroCurrent);
        EXPECT_EQ(recorder.data().events.back().kind, kCoilRest) << "after the coils are safe";
      });
  EXPECT_EQ(text.find("coils 0.0"), 0U) << text;
  EXPECT_NE(text.find(" A, read back at "), std::string::npos) << text;
}

// The heartbeat line in the simulated laboratory: currents flow through its relay, or not at all.
TEST_F(RunEngineTest, WithAHeartbeatLineARunGoesAsWithout) {
  std::ofstream(folder.path() / "rig.lua") << "return { base = '" VITREO_SOURCE_DIR
                                              "/scripts/rigs/simulated.lua',\n"
                                              "enable_line = { driver = 'serial_line' } }";
  rig_file = (folder.path() / "rig.lua").string();
  const RunResult result =
      run("rig.coils:set_currents { 1, 1, 1, 1, 1, 1, 1, 1 }\nrun:wait(1*s)\n"
          "rig.coils:set_currents { 0, 0, 0, 0, 0, 0, 0, 0 }\nrun:wait(3*s)\n" +
              held_and_then(""),
          [&](const Recorder& recorder, OpenRig& rig) {
            ASSERT_NE(rig.rig().enable_line, nullptr);
            EXPECT_FALSE(rig.rig().enable_line->high());
            const Stream& servo = *recorder.stream("servo");
            EXPECT_GT(servo.times.size(), 5U);
          });
  EXPECT_EQ(result.outcome, Outcome::completed) << result.reason;
}

TEST_F(RunEngineTest, AnErrorWhileConstantCurrentsFlowLeavesZero) {
  run("rig.coils:set_currents { 3, 3, 3, 3, 3, 3, 3, 3 }\nrun:wait(0.1*s)\nerror {}");
  EXPECT_EQ(outcome_in_record, Outcome::failed);
}

TEST_F(RunEngineTest, ADeviceThatRefusesAbortsTheRunAndLeavesZero) {
  const RunResult result =
      run("rig.coils:set_currents { 2, 2, 2, 2, 2, 2, 2, 2 }\n"
          "rig.coils:set_currents { 11.9, 11.9, 11.9, 11.9, 11.9, 11.9, 11.9, 11.9 }");
  EXPECT_EQ(result.outcome, Outcome::aborted) << result.reason;
  EXPECT_EQ(result.exit_code, ExitCode::aborted);
}

TEST_F(RunEngineTest, ADeviceThatFailsInsideTheLoopAbortsTheRunAndLeavesZero) {
  const RunResult result =
      run(held_and_then("pcall(function() rig.coils:set_currents { 99, 0, 0, 0, 0, 0, 0, 0 } end)\n"
                        "run:wait(0.5*s)\nservo:go_to { 1*mm, 0, 0 }"));
  EXPECT_EQ(result.outcome, Outcome::aborted) << result.reason;
}

TEST_F(RunEngineTest, CtrlCWhileItWaitsStopsTheRunAndLeavesZero) {
  // What the script prints raises the signal; the wait that follows is the one it must end.
  struct Interrupting : SilentListener {
    void message(const std::string&) override { raise(SIGINT); }
  } interrupting;
  const std::string file = (folder.path() / "long.lua").string();
  std::ofstream(file)
      << "return { title = 't', needs = { 'coils' }, run = function(rig, p, run)\n"
         "rig.coils:set_currents { 1, 1, 1, 1, 1, 1, 1, 1 }\nprint('now')\nrun:wait(3000)\nend }";
  RunRequest request;
  request.what.protocol_file = file;
  request.where.rig_file = VITREO_SOURCE_DIR "/scripts/rigs/simulated.lua";
  request.where.out = (folder.path() / "runs").string();
  const RunResult result =
      run_protocol(*engine, request, interrupting, [&](const Recorder& recorder, OpenRig& rig) {
        inspected = true;
        for (const double volts : rig.laboratory()->coil_outputs().outputs())
          EXPECT_NEAR(volts, 0, kZeroVolts);
        EXPECT_EQ(recorder.end()->outcome, Outcome::stopped);
        EXPECT_LT(recorder.end()->experiment_time, 10) << "it did not sit out the wait";
      });
  EXPECT_EQ(result.exit_code, ExitCode::stopped);
}

TEST_F(RunEngineTest, AStopRunsTheScriptsOwnCleanUpFirst) {
  struct Interrupting : SilentListener {
    void message(const std::string& line) override {
      lines += line + ";";
      if (line == "now") raise(SIGINT);
    }
    std::string lines;
  } interrupting;
  const std::string file = (folder.path() / "clean.lua").string();
  std::ofstream(file) << "return { title = 't', needs = {}, run = function(rig, p, run)\n"
                         "local x <close> = setmetatable({}, { __close = function() run:wait(0.1) "
                         "print('closed') end })\n"
                         "print('now')\nrun:wait(3000)\nprint('never')\nend }";
  RunRequest request;
  request.what.protocol_file = file;
  request.where.rig_file = VITREO_SOURCE_DIR "/scripts/rigs/simulated.lua";
  request.where.out = (folder.path() / "runs").string();
  run_protocol(*engine, request, interrupting,
               [&](const Recorder&, OpenRig&) { inspected = true; });
  EXPECT_EQ(interrupting.lines, "now;closed;");
}

TEST(RunEngine, AFaceThatThrowsEndsTheRunWithItsReasonInTheRecordAndTheCoilsAtZero) {
  struct Broken : Face {
    void begin(Session& session) override {
      began = &session;
      throw std::runtime_error("the page has burnt down");
    }
    void end(const std::string&) override { ended = began != nullptr; }
    Session* began = nullptr;
    bool ended = false;
  } broken;
  const TemporaryFolder folder;
  SilentListener listener;
  const auto engine = make_lua_engine({VITREO_SOURCE_DIR "/scripts"});
  RunRequest request;
  request.what.protocol_file = VITREO_SOURCE_DIR "/protocols/hello_rig.lua";
  request.where.rig_file = VITREO_SOURCE_DIR "/scripts/rigs/simulated.lua";
  request.where.out = (folder.path() / "runs").string();
  request.how.faces = {&broken};
  const RunResult result =
      run_protocol(*engine, request, listener, [](const Recorder& recorder, OpenRig& rig) {
        ASSERT_NE(recorder.end(), nullptr);
        EXPECT_EQ(recorder.end()->reason, "the page has burnt down");
        for (const double volts : rig.laboratory()->coil_outputs().outputs())
          EXPECT_NEAR(volts, 0, kZeroVolts);
      });
  EXPECT_EQ(result.outcome, Outcome::failed);
  EXPECT_EQ(result.exit_code, ExitCode::internal);
  EXPECT_TRUE(broken.ended) << "it is let go of before the session dies";
}

// A stop may come while the faces begin, such as by the control socket, which is the first of them.
TEST(RunEngine, AStopBeforeTheScriptsFirstLineIsAStopWithItsReason) {
  struct Early : Face {
    void begin(Session& session) override {
      session.control.request(StopTier::stop, "by a person who was quick", {"operator"});
      session.clock.sleep_for(std::chrono::milliseconds(10));
    }
    void end(const std::string& outcome) override { told = outcome; }
    std::string told;
  } early;
  const TemporaryFolder folder;
  SilentListener listener;
  const auto engine = make_lua_engine({VITREO_SOURCE_DIR "/scripts"});
  RunRequest request;
  request.what.protocol_file = VITREO_SOURCE_DIR "/protocols/hello_rig.lua";
  request.where.rig_file = VITREO_SOURCE_DIR "/scripts/rigs/simulated.lua";
  request.where.out = (folder.path() / "runs").string();
  request.how.faces = {&early};
  const RunResult result =
      run_protocol(*engine, request, listener, [](const Recorder& recorder, OpenRig&) {
        ASSERT_NE(recorder.end(), nullptr);
        EXPECT_EQ(recorder.end()->reason, "stopped by a person who was quick");
      });
  EXPECT_EQ(result.outcome, Outcome::stopped);
  EXPECT_EQ(result.exit_code, ExitCode::stopped);
  EXPECT_EQ(early.told, "stopped: stopped by a person who was quick");
}

TEST(RunEngine, AMotionBeyondTheTravelIsTheScriptsFailureAndSaysItInMillimeters) {
  const TemporaryFolder folder;
  SilentListener listener;
  const auto engine = make_lua_engine({VITREO_SOURCE_DIR "/scripts"});
  const std::string file = (folder.path() / "far.lua").string();
  std::ofstream(file) << "return { title = 't', needs = { 'stage' }, run = function(rig, p, run)\n"
                         "rig.stage:move_to({ 9 }, { speed = 1e-4 })\nend }";
  RunRequest request;
  request.what.protocol_file = file;
  request.where.rig_file = VITREO_SOURCE_DIR "/scripts/rigs/simulated.lua";
  request.where.out = (folder.path() / "runs").string();
  const RunResult result = run_protocol(*engine, request, listener);
  EXPECT_EQ(result.exit_code, ExitCode::script_error) << result.reason;
  EXPECT_EQ(result.outcome, Outcome::failed);
  EXPECT_NE(result.reason.find("9000 mm on axis "), std::string::npos) << result.reason;
}

TEST(RunEngine, WhatIsWrongWithTheRequestLeavesNoFolder) {
  const TemporaryFolder folder;
  SilentListener listener;
  const auto engine = make_lua_engine({VITREO_SOURCE_DIR "/scripts"});
  RunRequest request;
  request.what.protocol_file = VITREO_SOURCE_DIR "/protocols/servo_square.lua";
  request.where.rig_file = VITREO_SOURCE_DIR "/scripts/rigs/simulated.lua";
  request.what.arguments = {"speed=5um"};
  request.where.out = (folder.path() / "runs").string();
  EXPECT_THROW(run_protocol(*engine, request, listener), ConfigError);
  EXPECT_FALSE(std::filesystem::exists(folder.path() / "runs"));
}

TEST(RunEngine, AFolderThatCannotBeMadeIsNamed) {
  SilentListener listener;
  const auto engine = make_lua_engine({VITREO_SOURCE_DIR "/scripts"});
  RunRequest request;
  request.what.protocol_file = VITREO_SOURCE_DIR "/protocols/hello_rig.lua";
  request.where.rig_file = VITREO_SOURCE_DIR "/scripts/rigs/simulated.lua";
  request.where.out = "/proc/nowhere";
  try {
    run_protocol(*engine, request, listener);
    FAIL();
  } catch (const std::exception& error) {
    EXPECT_NE(std::string(error.what()).find("/proc/nowhere"), std::string::npos) << error.what();
  }
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
