// rig.stage, rig.rotation_stage and rig.field_probe as scripts have them: units, limits, waits that
// yield.
// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/scpi_probe/driver.h"
#include "devices/instruments/scpi_probe/emulator.h"
#include "devices/instruments/zaber/driver.h"
#include "devices/instruments/zaber/emulator.h"
#include "tests/host/lua/interpreter/lua_bench.h"

namespace vitreo {
namespace VITREO_TEST_FILE {

class StageBinding : public LuaBench {
 protected:
  StageBinding() {
    rig.stage = stage.get();
    rig.rotation_stage = table.get();
    rig.field_probe = probe.get();
  }
  static zaber::Settings turning() {
    zaber::Settings settings;
    settings.name = "rotation_stage";
    settings.axes[0].step = 1e-3;
    settings.axes[0].travel_max = 6;
    settings.axes[0].max_speed = settings.axes[0].speed = 0.5;
    return settings;
  }

  std::unique_ptr<zaber::Emulator> chain = zaber::make_emulator(),
                                   turntable = zaber::make_emulator();
  std::unique_ptr<BytePeer> teslameter = scpi_probe::make_emulator({}, [](Time) {
    return std::vector<double>{1e-3, 0, -2e-3};
  });
  std::unique_ptr<Stage> stage = zaber::open(memory_byte_link(*chain, *clock), {}, *clock);
  std::unique_ptr<RotationStage> table =
      zaber::open_rotary(memory_byte_link(*turntable, *clock), turning(), *clock);
  std::unique_ptr<FieldProbe> probe = scpi_probe::open(
      memory_byte_link(*teslameter, *clock), {.model = "", .setup = "", .axes = 3}, *clock);
};

TEST_F(StageBinding, MovesInMetersAtTheSpeedThatIsAsked) {
  EXPECT_EQ(run("local start = run:now() rig.stage:move_to({1e-3}, { speed = 1e-3 })\n"
                "assert(math.abs(rig.stage:position()[1] - 1e-3) < 1e-7)\n"
                "local took = run:now() - start assert(took > 0.99 and took < 1.1, took)")
                .error,
            "");
  EXPECT_NEAR(chain->position(0, 0, clock->now()) * 3.048e-6 / 64, 1e-3, 1e-7);
}

TEST_F(StageBinding, GoesOnWithTheScriptWhileItMoves) {
  EXPECT_EQ(run("local motion = rig.stage:start({2e-3}) assert(not motion:done())\n"
                "run:wait(0.2) assert(not motion:done() and rig.stage:position()[1] > 0.2e-3)\n"
                "motion:wait() assert(motion:done()) motion:wait()\n"
                "assert(math.abs(rig.stage:position()[1] - 2e-3) < 1e-7)\n"
                "local order = ''\n"
                "run:together(function() rig.stage:move_to({0}) order = order .. 'stage' end,\n"
                "             function() run:wait(0.1) order = order .. 'script ' end)\n"
                "assert(order == 'script stage', order)")
                .error,
            "");
}

TEST_F(StageBinding, StopsAndSaysSoToWhoeverWaits) {
  EXPECT_EQ(run("local motion = rig.stage:start({2e-3}) run:wait(0.1) rig.stage:stop()\n"
                "assert(motion:done())\n"
                "for i = 1, 2 do\n"
                "  local ok, why = pcall(motion.wait, motion)\n"
                "  assert(not ok and why.kind == 'refused' and why.message:find('stopped on its "
                "way'), why)\n"
                "end\n"
                // each of two tasks that wait, though the stage tells one only
                "local ended = 0\n"
                "local other = rig.stage:start({4e-3})\n"
                "local function waits()\n"
                "  if not pcall(other.wait, other) then ended = ended + 1 end\n"
                "end\n"
                "run:together(waits, waits, function() run:wait(0.1) rig.stage:stop() end)\n"
                "assert(ended == 2, ended)")
                .error,
            "");
}

TEST_F(StageBinding, AMotionKeepsHowItEndedPastTheNextOne) {
  EXPECT_EQ(run("local arrived = rig.stage:start({0.1e-3}) run:wait(1)\n"
                "local stopped = rig.stage:start({5e-3}) run:wait(0.1) rig.stage:stop()\n"
                "local last = rig.stage:start({20e-3})\n"
                "local before = run:now()\n"
                "assert(arrived:done() and stopped:done() and not last:done())\n"
                "arrived:wait()\n"
                "local ok, why = pcall(stopped.wait, stopped)\n"
                "assert(not ok and why.message:find('stopped on its way'), why)\n"
                "assert(not last:done() and run:now() - before < 0.5)\n"
                "last:wait()\n"
                // a move and a homing begin anew, too
                "stopped = rig.stage:start({0}) rig.stage:stop() rig.stage:move_to({1e-3})\n"
                "assert(not pcall(stopped.wait, stopped))\n"
                "stopped = rig.stage:start({0}) rig.stage:stop() rig.stage:home()\n"
                "assert(not pcall(stopped.wait, stopped))")
                .error,
            "");
}

TEST_F(StageBinding, RefusesANewMotionWhileItMovesAndTheOldOneGoesOn) {
  EXPECT_EQ(run("local motion = rig.stage:start({2e-3})\n"
                "local ok, why = pcall(rig.stage.start, rig.stage, {0})\n"
                "assert(not ok and why.kind == 'refused' and why.message:find('still moving'))\n"
                "assert(not motion:done()) motion:wait()\n"
                "assert(math.abs(rig.stage:position()[1] - 2e-3) < 1e-7)")
                .error,
            "");
}

TEST_F(StageBinding, AMotionThatIsNotThereInTimeIsStoppedAndNamesItsTarget) {
  EXPECT_EQ(run("local motion = rig.stage:start({20e-3}, { speed = 1e-3 })\n"
                "local ok, why = pcall(motion.wait, motion, { timeout = 0.5 })\n"
                "assert(not ok and why.kind == 'timeout' and why.device == 'stage')\n"
                "for _, part in ipairs { 'wanted 20 mm', 'last reading', 'after 5' } do\n"
                "  assert(why.message:find(part), why)\n"
                "end\n"
                "ok, why = pcall(motion.wait, motion) assert(not ok and why.kind == 'timeout')\n"
                "assert(motion:done())")
                .error,
            "");
  EXPECT_FALSE(chain->moving(0, 0, clock->now()));
  expect_all(run("rig.stage:start({1e-3}):wait { timeout = -1 }").error,
             {"motion:wait: timeout: wants", "got -1 s"});
}

TEST_F(StageBinding, RefusesWhatIsBeyondItsLimitsAndWhatIsNoTarget) {
  EXPECT_EQ(run("local ok, why = pcall(rig.stage.move_to, rig.stage, {1})\n"
                "assert(not ok and why.kind == 'out of range' and why.message:find('outside its "
                "travel'), why)\n"
                "ok, why = pcall(rig.stage.move_to, rig.stage, {1e-3}, { speed = 1 })\n"
                "assert(not ok and why.message:find('faster than'))\n"
                "ok, why = pcall(rig.stage.move_to, rig.stage, {1e-3, 1e-3})\n"
                "assert(not ok and tostring(why):find('has 1 axes'))\n"
                "assert(not pcall(rig.stage.move_to, rig.stage, 1e-3))\n"
                "assert(rig.stage:position()[1] == 0)")
                .error,
            "");
}

TEST_F(StageBinding, StopsTheStageWhenTheScriptIsStopped) {
  const auto operator_ = clock->spawn("operator", [&] {
    clock->sleep_for(std::chrono::milliseconds(500));
    clock->interrupt();
  });
  EXPECT_TRUE(run("rig.stage:move_to({20e-3})").stopped);
  EXPECT_FALSE(chain->moving(0, 0, clock->now()));
}

TEST_F(StageBinding, ShowsWhoItIsAndItsLimits) {
  EXPECT_EQ(run("local info = rig.stage:info()\n"
                "assert(info.name == 'Zaber device 50081' and info.serial == '12345' and "
                "info.firmware == '7.14')\n"
                "assert(info.axes[1].name == 'z' and info.axes[1].travel_max > 50e-3)\n"
                "assert(rig.rotation_stage:info().max_speed == 0.5 and rig.field_probe:info().axes "
                "== 3)\n"
                "rig.stage:home()")
                .error,
            "");
}

TEST_F(StageBinding, TurnsInRadians) {
  EXPECT_EQ(run("rig.rotation_stage:move_to(1, { speed = 0.5 }) "
                "assert(math.abs(rig.rotation_stage:position() - 1) < 1e-4)\n"
                "local motion = rig.rotation_stage:start(2)\n"
                "assert(tostring(motion) == 'motion' and not motion:done()) "
                "rig.rotation_stage:stop()\n"
                "local ok, why = pcall(rig.rotation_stage.move_to, rig.rotation_stage, 7)\n"
                "assert(why.message:find('deg'), why)\n"
                "assert(not ok and why.device == 'rotation_stage')")
                .error,
            "");
}

TEST_F(StageBinding, MeasuresInTesla) {
  EXPECT_EQ(run("local b = rig.field_probe:measure()\n"
                "assert(#b == 3 and b[1] == 1e-3 and b[3] == -2e-3 and b.time >= 0)")
                .error,
            "");
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
