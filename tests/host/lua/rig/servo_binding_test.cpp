// The servo from Lua, on the simulated rig, and the shipped protocols.
// SPDX-License-Identifier: Apache-2.0
#include "tests/host/lua/interpreter/lua_bench.h"

namespace vitreo {
namespace VITREO_TEST_FILE {

class ServoBinding : public ::testing::Test {
 protected:
  Ended run(const std::string& body) {
    const std::filesystem::path file = bench.folder.path() / "p.lua";
    std::ofstream(file)
        << "return { title = 't', run = function(rig, p, run)\n"
           "rig.sample:remove_robot() local background = rig:learn_background { frames = 4 }\n"
           "local servo <close> = rig:servo { background = background }\n"
           "servo:hold({0, 0, 0})\n"
        << body << "\nend }";
    return ended([&] { engine->run(engine->describe(file.string()), {}, *bench.session); });
  }
  static Ended ended(const std::function<void()>& body) {
    struct Opened : LuaBench {
      using LuaBench::ended;
    };
    return Opened::ended(body);
  }
  bool coils_are_at_zero() {
    for (const double current : bench.roles().coils->currents())
      if (current != 0) return false;
    return true;
  }

  TestBench bench;
  std::unique_ptr<ScriptEngine> engine =
      make_lua_engine({std::string(VITREO_SOURCE_DIR) + "/scripts"});
};

TEST_F(ServoBinding, GoesToAPlaceFollowsAPathAndEndsAtZero) {
  const Ended end = run(
      "rig.sample:insert_robot({0, 0, 0})\nlocal at = servo:wait_until_tracked()\nassert(at:norm() "
      "< 2e-3)\n"
      "servo:go_to({1e-3, 0, 0}, { within = 500e-6, timeout = 30 })\n"
      "local now = servo:status()\n"
      "assert((servo:position() - {1e-3, 0, 0}):norm() < 1e-3 and now.state == 'holding' and "
      "now.target.x == 1e-3)\n"
      "local took = servo:follow({ {1e-3, 0, 0}, {0, 0, 0} }, { speed = 1e-3 })\nassert(took > 1 "
      "and took < 2, "
      "took)\n"
      "assert(now.trim:norm() == 0 and now.offset:norm() == 0)\n"
      "local correction = servo:mean_correction(1) servo:set_trim(now.trim + correction)\n"
      "assert(servo:status().trim == correction and correction:norm() < 1e-4)\n"
      "servo:set_offset({0, 0, 50e-6}) assert(servo:status().offset.z == 50e-6)\n"
      "local s = servo:status() assert(s.state == 'holding' and s.progress == 1 and s.position and "
      "s.headroom > 0)\n"
      "servo:release() run:wait(0.2) assert(servo:status().state == 'released')\n"
      "servo:close() servo:close()\nassert(tostring(servo) == 'closed servo')\nservo:position()");
  expect_all(end.error, {"servo:position: the servo is closed"});
  EXPECT_TRUE(coils_are_at_zero());
}

TEST_F(ServoBinding, SaysHowNearTheSurfaceIsAndRefusesWhatIsNearerThanTheMargin) {
  const Ended end = run(
      "assert(servo:clearance() == nil)\n"
      "rig.sample:insert_robot({0, 0, 0}) servo:wait_until_tracked() run:wait(2)\n"
      "local c = servo:clearance()\n"
      "assert(c.wall == 'retina' and c.margin == 0.2e-3 and not c.kept_out)\n"
      "assert(c.distance > 4e-3 and c.distance < 5e-3 and c.retina == c.distance and c.lens > "
      "9e-3)\n"
      "assert(c.uncertainty > 0.1e-3 and math.abs(c.bound - c.distance + c.uncertainty) < 1e-12)\n"
      "assert(c.away.z > 0.9)\n"
      "servo:release { touch = true }\n"
      "servo:hold({0, 0, -4.9e-3})");
  expect_all(end.error, {"servo:hold: ", "mm inside the retina", "0.20 mm must be left"});
}

TEST_F(ServoBinding, SaysWhatItMissed) {
  expect_all(run("servo:wait_until_tracked { timeout = 1 }").error,
             {"p.lua:5: servo:wait_until_tracked: no robot was seen by the servo", "after 1 s"});
  EXPECT_TRUE(coils_are_at_zero());
}

// A frame that was on its way shows the robot where it was before it was put elsewhere.
TEST_F(ServoBinding, AFrameFromBeforeIsNoSightOfTheRobot) {
  const Ended end =
      run("rig.sample:insert_robot({3e-3, 0, 0}) servo:wait_until_tracked() servo:close()\n"
          "local function put(loop, x)\n"
          "  loop:hold({x, 0, 0}) rig.sample:remove_robot() rig.sample:insert_robot({x, 0, 0})\n"
          "  local at = loop:wait_until_tracked() assert((at - {x, 0, 0}):norm() < 1.5e-3, at)\n"
          "end\n"
          "for k = 1, 5 do\n"
          "  run:wait(k * 0.013)\n"
          "  local again <close> = rig:servo { background = background, law = 'estimator' }\n"
          "  put(again, 0) put(again, 3e-3)\n"
          "end");
  EXPECT_EQ(end.error, "");
}

TEST_F(ServoBinding, ARobotThatWasLostIsSearchedAnewByHold) {
  const Ended end =
      run("rig.sample:insert_robot({0, 0, 0}) servo:wait_until_tracked()\n"
          "rig.sample:remove_robot() run:wait(3)\n"
          "assert(servo:status().state == 'lost')\n"
          "assert(not pcall(servo.go_to, servo, {1e-3, 0, 0}))\n"
          "servo:hold({1e-3, 0, 0})\n"
          "run:wait(3) assert(servo:status().state == 'searching', servo:status().state)\n"
          "rig.sample:insert_robot({1e-3, 0, 0})\n"
          "local at = servo:wait_until_tracked() assert((at - {1e-3, 0, 0}):norm() < 1.5e-3)\n"
          "run:wait(3) assert(servo:status().state == 'holding')\n"
          "assert((servo:position() - {1e-3, 0, 0}):norm() < 0.5e-3, servo:position())\n"
          "rig.sample:remove_robot() run:wait(3) assert(servo:status().state == 'lost')");
  EXPECT_EQ(end.error, "");
}

TEST_F(ServoBinding, ATimeoutNamesTargetElapsedAndLastPlace) {
  expect_all(run("rig.sample:insert_robot({0, 0, 0}) "
                 "servo:wait_until_tracked()\nservo:go_to({3e-3, 0, 0}, { timeout = 1 })")
                 .error,
             {"p.lua:6: servo:go_to: the robot was not within 100 \u00b5m of (3.00, 0.00, 0.00) mm",
              "after 1 s", "away"});
  EXPECT_TRUE(coils_are_at_zero());
}

TEST_F(ServoBinding, RefusesWrongArguments) {
  expect_all(run("servo:go_to({0, 0, 0}, { within = 'near' })").error,
             {"servo:go_to: within: wants a number in m, got a string"});
  expect_all(run("servo:go_to({0, 0})").error,
             {"servo:go_to: position: wants a position {x, y, z} in m, got a table"});
  expect_all(run("servo:follow({ 1, 2 })").error,
             {"servo:follow: points: number 1 is not a position"});
  expect_all(run("servo:position()").error, {"servo:position: the robot is not seen"});
  expect_all(run("servo:set_trim()").error,
             {"servo:set_trim: force: is missing; wants a force {x, y, z} in N"});
  expect_all(run("servo:set_offset({0, 0, 4e-3})").error,
             {"servo:set_offset: offset: wants at most 3 mm, got 4 mm"});
  expect_all(run("servo:close() rig:servo { background = background, dead_coils = { 1.5 } }").error,
             {"rig:servo: dead_coils: wants numbers of coils, 1 to ", "got 1.5"});
}

TEST_F(ServoBinding, AServoLeftOpenIsClosedWithTheRun) {
  const Ended end =
      run("kept = rig:learn_background { frames = 2 }\nservo:close()\nkept = rig:servo { "
          "background = background }\n"
          "rig.sample:insert_robot({0, 0, 0}) kept:hold({0, 0, 0}) kept:wait_until_tracked() "
          "run:wait(1) error('leave')");
  expect_all(end.error, {"leave"});
  EXPECT_TRUE(coils_are_at_zero());
}

TEST(Protocols, AllDescribeThemselves) {
  const std::filesystem::path root = VITREO_SOURCE_DIR;
  const auto engine = make_lua_engine({(root / "scripts").string()});
  int count = 0;
  for (const auto& entry : std::filesystem::directory_iterator(root / "protocols")) {
    const ProtocolDescription protocol = engine->describe(entry.path().string());
    EXPECT_FALSE(protocol.about.empty()) << entry.path();
    ++count;
  }
  EXPECT_GE(count, 2);
}

TEST(Protocols, ServoSquareRunsASmallSquare) {
  const std::filesystem::path root = VITREO_SOURCE_DIR;
  TestBench bench;
  const auto engine = make_lua_engine({(root / "scripts").string()});
  const ProtocolDescription protocol =
      engine->describe((root / "protocols" / "servo_square.lua").string());
  engine->run(protocol, check_arguments(protocol, {"width=1mm", "depth=1mm", "speed=1mm/s"}),
              *bench.session);
  std::vector<std::string> names;
  for (const StatedResult& one : bench.recorder->results()) names.push_back(one.name);
  EXPECT_EQ(names, (std::vector<std::string>{
                       "path_error_rms", "path_error_lateral_rms", "path_error_depth_rms",
                       "localization_error_mean", "localization_error_max", "verdict_goal_met",
                       "verdict_goal_missed", "verdict_differs", "verdict_shown"}));
  for (const StatedResult& one : bench.recorder->results()) {
    if (one.unit == "m") {
      EXPECT_LT(one.value, 1e-3) << one.name;
    }
  }
  EXPECT_EQ(bench.recorder->plots().size(), 4u);
  EXPECT_EQ(bench.recorder->tables().size(), 2u);
  EXPECT_GE(bench.recorder->pictures().size(), 2u);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
