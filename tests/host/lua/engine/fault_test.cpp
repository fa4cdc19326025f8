// Faults on purpose: each acts, is an event of the record, and the run ends with the outputs at
// zero.
// SPDX-License-Identifier: Apache-2.0
#include "host/engine/run_engine.h"
#include "host/lua/engine/engine.h"
#include "host/session/faults.h"
#include "tests/host/lua/engine/written_run.h"
#include "tests/host/rig/fake_rig.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <thread>

namespace vitreo {
namespace VITREO_TEST_FILE {

constexpr double kZeroVolts = 5e-3;

// A pose sensor and no camera: quick.
constexpr const char* kPoseRig = R"(
local units = require "units"
return { title = "by the pose sensor", coils = {}, pose_sensor = {}, sample = {}, lens_mover = {},
         stage = { driver = "simulated", carries = "probe" } }
)";
constexpr const char* kHold = R"(
local servo = rig:servo { feedback = "pose_sensor" }
servo:hold { 0, 0, 0 }
rig.sample:insert_robot { 0, 0, 0 }
servo:wait_until_tracked { timeout = 5*s }
run:wait(2*s)
servo:go_to({ 0, 0, 0 }, { within = 2*mm, timeout = 5*s })
)";
constexpr const char* kLook = R"(
local background = rig:learn_background { frames = 2 }
local servo = rig:servo { background = background }
servo:hold { 0, 0, 0 }
rig.sample:insert_robot { 0, 0, 0 }
servo:wait_until_tracked { timeout = 5*s }
run:wait(1*s)
servo:go_to({ 0, 0, 0 }, { within = 2*mm, timeout = 5*s })
)";

struct Ending {
  RunResult result;
  std::string events;  // "kind: text", a line each
  double volts = 0;    // largest, at the end
  double wrong = 0;    // m: how far a tracked place was from the truth, at most
  bool says(const std::string& text) const {
    return events.find(text) != std::string::npos || result.reason.find(text) != std::string::npos;
  }
};

/// Of a place: an ellipse's depth is uncertain by some tenths of a millimeter; what is farther off
/// is something else.
constexpr double kBelievable = 1.5e-3;
/// As far as something at the robot's edge pulls it while most of the rim is in line: 0.2 mm, half
/// of that more allowed.
constexpr double kPulled = 0.3e-3;

double worst_error(const Recorder& recorder) {
  const auto stream = [&recorder](const char* name) {
    const auto& streams = recorder.streams();
    const auto found = std::find_if(streams.begin(), streams.end(),
                                    [&](const auto& one) { return one.info.name == name; });
    return found == streams.end() ? nullptr : &*found;
  };
  const Stream *const servo = stream("servo"), *const truth = stream("truth");
  if (servo == nullptr || truth == nullptr) return 0;
  double worst = 0;
  for (std::size_t i = 0; i < servo->times.size(); ++i) {
    const auto same = std::find(truth->times.begin(), truth->times.end(), servo->times[i]);
    if (same == truth->times.end() || !std::isfinite(servo->at(i, 0))) continue;
    const auto j = static_cast<std::size_t>(same - truth->times.begin());
    const auto off = [&](std::size_t axis) { return servo->at(i, axis) - truth->at(j, axis); };
    worst = std::max(worst, std::hypot(off(0), off(1), off(2)));
  }
  return worst;
}

class FaultTest : public ::testing::Test {
 protected:
  Ending run(const std::string& rig, const std::string& body,
             const std::vector<std::string>& faults, Pace pace = Pace::as_fast_as_possible) {
    RunRequest request = written_run(folder.path(), rig, body);
    request.how.faults = faults;
    request.how.pace = pace;
    Ending ending;
    ending.result =
        run_protocol(*engine, request, listener, [&](const Recorder& recorder, OpenRig& open) {
          for (const double volts : open.laboratory()->coil_outputs().outputs())
            ending.volts = std::max(ending.volts, std::abs(volts));
          ending.wrong = worst_error(recorder);
          for (const Event& event : recorder.events())
            ending.events += event.kind + ": " + event.text + "\n";
        });
    return ending;
  }

  Ending held_with(const std::string& fault) { return run(kPoseRig, kHold, {fault}); }
  Ending watched_with(const std::string& fault) {
    return run(VITREO_SOURCE_DIR "/scripts/rigs/simulated.lua", kLook, {fault});
  }
  static void expect(const Ending& ending, Outcome outcome, const std::string& says) {
    EXPECT_EQ(ending.result.outcome, outcome) << ending.result.reason << "\n" << ending.events;
    EXPECT_TRUE(ending.says(says)) << ending.result.reason << "\n" << ending.events;
    EXPECT_LT(ending.volts, kZeroVolts);
    EXPECT_NE(ending.events.find("fault: "), std::string::npos) << ending.events;
  }

  TemporaryFolder folder;
  SilentListener listener;
  std::unique_ptr<ScriptEngine> engine = make_lua_engine({VITREO_SOURCE_DIR "/scripts"});
};

TEST_F(FaultTest, AnAmplifierThatIsSilentEndsTheRun) {
  expect(held_with("coils:silent:after=1s"), Outcome::aborted, "no answer within");
}

TEST_F(FaultTest, AnAmplifierThatAnswersLateIsWaitedForUpToItsDeadline) {
  expect(held_with("coils:late:after=1s,by=50ms"), Outcome::completed,
         "fault: coils late by 50 ms");
  expect(held_with("coils:late:after=1s,by=800ms"), Outcome::aborted, "no answer within");
}

TEST_F(FaultTest, AnAmplifierWhoseAnswersAreCutShortOrGarbledEndsTheRun) {
  expect(held_with("coils:short:after=1s,by=1"), Outcome::aborted, "cut short");
  expect(held_with("coils:garbled:after=1s"), Outcome::aborted, "only answers to something else");
}

TEST_F(FaultTest, AnAmplifierThatIsUnpluggedEndsTheRunAndIsZeroedWhenItIsBack) {
  const Ending ending = held_with("coils:unplugged:after=1s,lasting=0.1s");
  expect(ending, Outcome::aborted, "is gone");
  EXPECT_TRUE(ending.says("fault over: coils unplugged") || ending.says("unsafe: "))
      << ending.events;
}

TEST_F(FaultTest, AnAmplifierThatStaysUnpluggedIsSaidToBeUnsafe) {
  const Ending ending = held_with("coils:unplugged:after=1s");
  EXPECT_EQ(ending.result.outcome, Outcome::aborted);
  EXPECT_GT(ending.volts, kZeroVolts) << "it holds its voltages: nobody can reach it";
  EXPECT_NE(ending.events.find("unsafe: "), std::string::npos) << ending.events;
}

TEST_F(FaultTest, AnAmplifierThatIsSaturatedIsNotDrivenBeyondItsLimits) {
  const Ending ending = held_with("coils:saturated:after=0.5s,by=0.2A");
  EXPECT_TRUE(ending.says("fault: coils saturated by 200 mA") ||
              ending.says("fault: coils saturated by 0.2 A"))
      << ending.events;
  EXPECT_LT(ending.volts, kZeroVolts);
}

TEST_F(FaultTest, APoseSensorThatFallsSilentOrIsUnpluggedEndsTheRun) {
  expect(held_with("pose_sensor:silent:after=1s"), Outcome::aborted, "dead-man: the servo loop");
  expect(held_with("pose_sensor:unplugged:after=1s"), Outcome::aborted, "is gone");
}

TEST_F(FaultTest, PlacesThatAreNotNumbersCountAsNotSeen) {
  const Ending ending = held_with("pose_sensor:nan:after=1s");
  EXPECT_NE(ending.result.outcome, Outcome::completed);
  EXPECT_TRUE(ending.says("a place is not a number")) << ending.events;
  EXPECT_TRUE(ending.says("lost: ")) << ending.events;
  EXPECT_LT(ending.volts, kZeroVolts);
}

TEST_F(FaultTest, ReadingsWithImpossibleTimesAreNotSteeredBy) {
  expect(held_with("pose_sensor:jump:after=1s,by=1h"), Outcome::aborted,
         "its time stamps cannot be believed");
  expect(held_with("pose_sensor:late:after=1s,by=800ms"), Outcome::aborted,
         "its time stamps cannot be believed");
}

TEST_F(FaultTest, ReadingsThatAreDroppedLeaveTheLoopAlive) {
  expect(held_with("pose_sensor:drops:after=1s,by=4"), Outcome::completed,
         "fault: pose_sensor drops by 4");
}

TEST_F(FaultTest, ACameraThatFallsSilentOrIsUnpluggedEndsTheRun) {
  expect(watched_with("top_camera:silent:after=2s"), Outcome::aborted, "dead-man: the servo loop");
  expect(watched_with("top_camera:unplugged:after=2s"), Outcome::aborted, "is gone");
}

TEST_F(FaultTest, APictureThatStandsStillIsFoundThoughItsNumbersGoOn) {
  const Ending ending = watched_with("top_camera:frozen:after=1.2s");
  expect(ending, Outcome::aborted, "its picture stands still");
}

TEST_F(FaultTest, FramesThatAreDroppedOrTornLeaveTheLoopAlive) {
  expect(watched_with("top_camera:drops:after=1s,by=4"), Outcome::completed,
         "fault: top_camera drops by 4");
  expect(watched_with("top_camera:torn:after=1s,by=4"), Outcome::completed,
         "fault: top_camera torn by 4");
}

TEST_F(FaultTest, ACameraThatSeesTooMuchOrTooLittleOrNothingSharpSaysSoOrIsRight) {
  for (const char* fault :
       {"overexposed:after=2s", "overexposed:after=2s,by=1000", "dark:after=2s",
        "dark:after=2s,by=1000000", "defocused:after=2s", "defocused:after=2s,by=60"}) {
    SCOPED_TRACE(fault);
    const Ending ending = watched_with(std::string("top_camera:") + fault);
    EXPECT_NE(ending.events.find("fault: top_camera"), std::string::npos) << ending.events;
    EXPECT_LT(ending.wrong, kBelievable) << ending.events;
    EXPECT_LT(ending.volts, kZeroVolts);
    if (ending.result.outcome == Outcome::completed) continue;
    EXPECT_TRUE(ending.says("lost: ") || ending.says("its picture stands still"))
        << ending.result.reason;
  }
}

TEST_F(FaultTest, ASpeckThatDriftsThroughThePictureDoesNotTakeTheTrackerAlong) {
  for (const char* fault : {"floater:after=1s,by=6", "floater:after=1s,by=20",
                            "floater:after=1s,by=40", "floater:after=1s,by=80"}) {
    SCOPED_TRACE(fault);
    const Ending ending =
        run(VITREO_SOURCE_DIR "/scripts/rigs/simulated.lua",
            std::string(kLook) + "run:wait(14*s)\n", {std::string("top_camera:") + fault});
    EXPECT_LT(ending.wrong, kPulled) << ending.events;
    EXPECT_LT(ending.volts, kZeroVolts);
    if (ending.result.outcome == Outcome::completed) continue;
    EXPECT_TRUE(ending.says("lost: ")) << ending.result.reason;
  }
}

TEST_F(FaultTest, ALensMoverWhoseLimitSwitchIsPressedRefusesToMove) {
  expect(
      run(kPoseRig, "run:wait(1*s)\nrig.lens_mover:move_to(1*mm)", {"lens_mover:limit:after=0.5s"}),
      Outcome::aborted, "lens_mover");
}

TEST_F(FaultTest, ALensMoverThatLosesItsStepsBelievesThatItIsThere) {
  const Ending ending =
      run(kPoseRig, "run:wait(1*s)\nrig.lens_mover:move_to(1*mm)\nprint(rig.lens_mover:position())",
          {"lens_mover:stuck:after=0.5s"});
  expect(ending, Outcome::completed, "fault: lens_mover stuck");
}

TEST_F(FaultTest, ALensMoverThatIsPluggedInAgainAnswersAgainAndHasNotMoved) {
  const Ending ending = run(kPoseRig,
                            "local lens = rig.lens_mover\nrun:wait(1*s)\n"
                            "assert(not pcall(lens.move_to, lens, 1*mm))\nrun:wait(2*s)\n"
                            "assert(math.abs(lens:position()) < 1e-6)\n"
                            "lens:move_to(1*mm)\nassert(math.abs(lens:position() - 1*mm) < 1e-5)",
                            {"lens_mover:unplugged:after=0.5s,lasting=1s"});
  expect(ending, Outcome::completed, "fault over: lens_mover unplugged");
}

TEST_F(FaultTest, AStageThatIsHeldStallsAndSaysSo) {
  expect(run(kPoseRig, "run:wait(0.4*s)\nrig.stage:move_to { 10*mm, 0, 0 }",
             {"stage:stuck:after=0.5s"}),
         Outcome::aborted, "stall");
  expect(
      run(kPoseRig, "run:wait(1*s)\nrig.stage:move_to { 1*mm, 0, 0 }", {"stage:stuck:after=0.5s"}),
      Outcome::aborted, "stall");
}

TEST_F(FaultTest, AStageThatDoesNotAnswerEndsTheRun) {
  expect(
      run(kPoseRig, "run:wait(1*s)\nrig.stage:move_to { 1*mm, 0, 0 }", {"stage:silent:after=0.5s"}),
      Outcome::aborted, "stage");
}

TEST_F(FaultTest, AFullDiskEndsTheRun) {
  const Ending ending = held_with("disk:full:after=1s");
  expect(ending, Outcome::aborted, "the disk is nearly full");
}

TEST_F(FaultTest, ASlowDiskIsWaitedForAndNothingIsLost) {
  expect(held_with("disk:slow:after=1s,by=0.3s"), Outcome::completed, "fault: disk slow by 300 ms");
}

TEST_F(FaultTest, AScriptInjectsThemItself) {
  const Ending ending =
      run(kPoseRig,
          "rig.simulation:fault('coils', 'late', { after = 0.2*s, lasting = 0.1*s, by = 20*ms })\n"
          "run:wait(1*s)",
          {});
  expect(ending, Outcome::completed, "fault: coils late by 20 ms for 100 ms");
  EXPECT_TRUE(ending.says("fault over: coils late")) << ending.events;
}

/// The whole chain at the pace of the wall clock: a task that has the turn and does not give it
/// back, energized coils, the watchdog's thread, the interlock.
TEST_F(FaultTest, AProgramThatDoesNotMoveLosesItsCoilsWhileItIsStillStuck) {
  using Steady = std::chrono::steady_clock;
  std::atomic<bool> done{false};
  std::thread watcher;
  std::atomic<Steady::time_point> in{}, out{}, zero{};
  RunRequest request =
      written_run(folder.path(), kPoseRig,
                  "rig.coils:set_currents { 1, 1, 1, 1, 1, 1, 1, 1 }\nrun:wait(5)\n"
                  "rig.coils:set_currents { 1, 1, 1, 1, 1, 1, 1, 1 }");
  request.how.pace = Pace::real_time;
  request.how.companion = [&](Session& session) {
    watcher = std::thread([&, coils = session.rig.coils] {
      while (!done && !coils->energized()) std::this_thread::yield();
      while (!done && coils->energized()) std::this_thread::sleep_for(std::chrono::milliseconds(1));
      zero = Steady::now();
    });
    session.keep(
        session.clock.spawn("stuck", [&, clock = &session.clock, coils = session.rig.coils] {
          while (!coils->energized()) clock->sleep_for(std::chrono::milliseconds(5));
          in = Steady::now();
          while (Steady::now() - in.load() < std::chrono::milliseconds(1500)) continue;
          out = Steady::now();
        }));
  };
  const RunResult result = run_protocol(*engine, request, listener, [&](const Recorder&, OpenRig&) {
    done = true;
    watcher.join();
  });
  EXPECT_EQ(result.outcome, Outcome::aborted);
  EXPECT_NE(result.reason.find("dead-man: the host has not moved for"), std::string::npos)
      << result.reason;
  EXPECT_LT(zero.load(), out.load()) << "it was tripped only when the task came back";
  const auto milliseconds = [&](auto span) {
    return std::chrono::duration<double, std::milli>(span).count();
  };
  std::printf("stuck for %.0f ms; coils at zero after %.0f ms\n",
              milliseconds(out.load() - in.load()), milliseconds(zero.load() - in.load()));
}

/// Fits, walks through tables, sorts: a script may compute for long while the loop holds its robot.
TEST_F(FaultTest, AScriptThatComputesForSecondsWhileItHoldsLosesNothing) {
  const std::string script =
      "local servo = rig:servo { feedback = 'pose_sensor' }\n"
      "servo:hold { 0, 0, 0 }\nrig.sample:insert_robot { 0, 0, 0 }\n"
      "servo:wait_until_tracked { timeout = 5*s }\nrun:wait(0.5*s)\n"
      "local before, x = os.clock(), 0\n"
      "repeat for i = 1, 100000 do x = x + i % 7 end until os.clock() - before > 1.5\n"
      // Short calls of the host in a loop are no wait either.
      "before = run:now()\nlocal most = 0\n"
      "while run:now() - before < 0.7*s do\n"
      "  for i = 1, 1000 do x = x + i % 7 end\n"
      "  most = math.max(most, (servo:position() - { 0, 0, 0 }):norm())\nend\n"
      "assert(most < 0.3*mm, most)\n"
      "assert(servo:status().state == 'holding')\n"
      "servo:go_to({ 0, 0, 0 }, { within = 0.1*mm, timeout = 2*s })";
  const Ending ending = run(kPoseRig, script, {}, Pace::real_time);
  EXPECT_EQ(ending.result.outcome, Outcome::completed) << ending.result.reason << "\n"
                                                       << ending.events;
  EXPECT_FALSE(ending.says("dead-man")) << ending.events;
  EXPECT_LT(ending.volts, kZeroVolts);
}

/// At the pace of the wall clock, with four times as many threads that only compute as there are
/// cores.
TEST_F(FaultTest, TooLittleProcessorTimeMayEndTheRunButIsNeverUnsafe) {
  std::atomic<bool> done{false};
  std::vector<std::thread> hogs;
  for (unsigned i = 0; i < 4 * std::max(1U, std::thread::hardware_concurrency()); ++i)
    hogs.emplace_back([&done] {
      while (!done) continue;
    });
  const Ending ending = run(kPoseRig, kHold, {"pose_sensor:drops:after=1s,by=4"}, Pace::real_time);
  done = true;
  for (std::thread& hog : hogs) hog.join();
  EXPECT_LT(ending.volts, kZeroVolts);
  EXPECT_EQ(ending.events.find("unsafe: "), std::string::npos) << ending.events;
  if (ending.result.outcome == Outcome::completed) return;
  EXPECT_TRUE(ending.says("dead-man") || ending.says("cannot be believed") || ending.says("lost") ||
              ending.says("timeout"))
      << ending.result.reason << "\n"
      << ending.events;
}

TEST_F(FaultTest, WhatMakesNoSenseIsRefusedByName) {
  const auto problem = [this](const std::string& word) {
    try {
      held_with(word);
    } catch (const ConfigError& error) {
      return std::string(error.what());
    }
    return std::string("no error");
  };
  EXPECT_NE(problem("coils").find("wants ROLE:KIND"), std::string::npos);
  EXPECT_NE(problem("coils:silnt").find("did you mean \"silent\""), std::string::npos);
  EXPECT_NE(problem("coils:frozen").find("cannot happen to coils"), std::string::npos);
  EXPECT_NE(problem("coils:late:by=3A").find("a time"), std::string::npos)
      << problem("coils:late:by=3A");
  EXPECT_NE(problem("coils:late:after=-1s").find("after: must be"), std::string::npos);
  EXPECT_NE(problem("coils:silent:by=3").find("is no option"), std::string::npos);
  EXPECT_NE(problem("top_camera:silent").find("top_camera is not there"), std::string::npos);
  EXPECT_NE(problem("stage:limit").find("cannot happen to stage"), std::string::npos);
  const Ending ending = run(kPoseRig, "rig.simulation:fault('coils', 'frozen')", {});
  EXPECT_EQ(ending.result.outcome, Outcome::failed);
  EXPECT_NE(ending.result.reason.find("p.lua:4"), std::string::npos) << ending.result.reason;
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
