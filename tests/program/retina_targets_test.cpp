// Targets by retina: the robot stays over a point of a retina that moves, judged by the simulator's
// drift and the robot's truth, which nothing in the loop is told.
// SPDX-License-Identifier: Apache-2.0
#include "tests/program/program.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

namespace vitreo {
namespace VITREO_TEST_FILE {

// The simulator's retina goes along a Lissajous figure of 1.5 mm (devices/sim/laboratory.cpp); a
// point of it is seen where the chief ray from the sphere at that place meets the sensor.
const char* const kOver = R"lua(
local retina_targets = require "session.retina_targets"
local units = require "units"
local mm, um, s = units.mm, units.um, units.s

local function shift(t)
  local phase = 1 * mm / s * t / (1.5 * mm)
  return 1.5 * mm * math.sin(phase), 0.75 * mm * math.sin(0.7 * phase)
end

local function pixel_of_retina(view, radius, x, y)
  return view:pixel(vector(x, y, radius - math.sqrt(radius ^ 2 - x ^ 2 - y ^ 2)))
end

-- The place on the retina that is seen at a pixel, by Newton's method.
local function behind(view, radius, wanted)
  local x, y, d = 0, 0, 20 * um
  for _ = 1, 20 do
    local at = pixel_of_retina(view, radius, x, y)
    local r, b = pixel_of_retina(view, radius, x + d, y), pixel_of_retina(view, radius, x, y + d)
    local a11, a12, a21, a22 = (r.u - at.u) / d, (b.u - at.u) / d, (r.v - at.v) / d, (b.v - at.v) / d
    local du, dv, det = wanted.u - at.u, wanted.v - at.v, a11 * a22 - a12 * a21
    x, y = x + (a22 * du - a12 * dv) / det, y + (a11 * dv - a21 * du) / det
  end
  return x, y
end

return {
  title = "Over a point of the retina",
  needs = { "top_camera", "coils", "sample" },
  run = function(rig, _, run)
    local servo <close> = rig:servo { feedback = "pose_sensor", law = "estimator" }
    servo:hold { 0.5 * mm, 0, 0 }
    rig.sample:insert_robot { 0.5 * mm, 0, 0 }
    servo:wait_until_tracked()
    run:wait(1 * s)
    local retina = retina_targets.open(rig, run, servo)
    retina_targets.look(retina)
    local place, fixed = vector(1 * mm, 0.5 * mm, 0), retina.time
    local target = retina_targets.fix(retina, place)
    local went = retina_targets.go_to(retina, target, { timeout = 40 * s })
    if not went.reached then error("not reached: " .. tostring(went.problem), 0) end
    local from = run:now()
    while run:now() - from < 10 * s do
      retina_targets.keep(retina, target)
    end
    local view, model = rig:view(), rig:model()
    local wanted = view:pixel(place - model.eye_in_world)
    local x, y = behind(view, model.retina_radius, wanted)
    local x0, y0 = shift(fixed)
    local one = view:pixel(place - model.eye_in_world + vector(100 * um, 0, 0))
    local scale = 100 * um / (one.u - wanted.u)
    local truth = run:samples("truth", { "x", "y", "z" }, { from = from, to = run:now() })
    local over, apart = 0, 0
    for k, t in ipairs(truth.time) do
      local dx, dy = shift(t)
      local there = pixel_of_retina(view, model.retina_radius, x + dx - x0, y + dy - y0)
      local robot = view:pixel(vector(truth.x[k], truth.y[k], truth.z[k]) - model.eye_in_world)
      over = over + (robot.u - there.u) ^ 2 + (robot.v - there.v) ^ 2
      apart = apart + (wanted.u - there.u) ^ 2 + (wanted.v - there.v) ^ 2
    end
    run:result("over", math.abs(scale) * math.sqrt(over / #truth.time), "m")
    run:result("at_rest", math.abs(scale) * math.sqrt(apart / #truth.time), "m")
    run:result("frames", retina.frames)
    run:result("found", retina.found)
    run:result("rows", #run:samples("robot_on_retina").time)
  end,
}
)lua";

TEST(RetinaTargets, TheRobotStaysOverAPointOfARetinaThatMoves) {
  const Workplace place;
  place.write("over.lua", kOver);
  for (int seed = 1; seed <= 2; ++seed) {
    const Spoken spoken =
        place.vitreo("run ./over.lua --rig drifting_eye --json --seed " + std::to_string(seed));
    ASSERT_EQ(spoken.exit_code, 0) << spoken.out << spoken.err;
    const auto results = nlohmann::json::parse(spoken.out)["results"];
    const double over = results["over"], at_rest = results["at_rest"];
    std::printf("seed %d: %.0f um from the point of the retina, rms; a robot at rest %.0f um\n",
                seed, over * 1e6, at_rest * 1e6);
    EXPECT_GT(at_rest, 0.8e-3) << "the retina moves";
    EXPECT_LT(over, 0.2e-3) << "as near as the loop holds a place at rest, through one camera";
    EXPECT_EQ(results["found"], results["frames"]);
    EXPECT_GT(results["rows"], 100) << "the robot's path on the retina is on record";
  }
}

// The zone's true middle in each of the loop's rows: the place of the simulator's retina that was
// seen there when it was fixed. `straight`: how near a straight way over the retina would have
// come.
const char* const kAround = R"lua(
    local servo <close> = rig:servo { feedback = "pose_sensor", law = "estimator" }
    servo:hold { -2 * mm, 0, 0 }
    rig.sample:insert_robot { -2 * mm, 0, 0 }
    servo:wait_until_tracked()
    run:wait(1 * s)
    local retina = retina_targets.open(rig, run, servo)
    retina_targets.look(retina)
    local middle, fixed = vector(0, 0.3 * mm, 0), retina.time
    local start = servo:position()
    retina_targets.forbid(retina, middle, 0.3 * mm)
    local target = retina_targets.fix(retina, vector(2 * mm, 0, 0))
    local within = retina_targets.fix(retina, vector(0.2 * mm, 0.3 * mm, 0))
    local refused = retina_targets.go_to(retina, within, { timeout = 5 * s })
    run:result("refused", (refused.problem or ""):match "no%-go zone 1" and 1 or 0)
    run:result("moved", (servo:position() - start):norm(), "m")
    local from = run:now()
    local went = retina_targets.go_to(retina, target, { timeout = 60 * s })
    run:result("reached", went.reached and 1 or 0)
    local view, model = rig:view(), rig:model()
    local wanted = view:pixel(middle - model.eye_in_world)
    local x, y = behind(view, model.retina_radius, wanted)
    local x0, y0 = shift(fixed)
    local one = view:pixel(middle - model.eye_in_world + vector(100 * um, 0, 0))
    local scale = math.abs(100 * um / (one.u - wanted.u))
    local truth = run:samples("truth", { "x", "y", "z" }, { from = from, to = run:now() })
    local least, retina_moved = math.huge, 0
    for k, t in ipairs(truth.time) do
      local dx, dy = shift(t)
      local there = pixel_of_retina(view, model.retina_radius, x + dx - x0, y + dy - y0)
      local robot = view:pixel(vector(truth.x[k], truth.y[k], truth.z[k]) - model.eye_in_world)
      least = math.min(least, scale * math.sqrt((robot.u - there.u) ^ 2 + (robot.v - there.v) ^ 2))
      retina_moved = math.max(retina_moved, scale * math.abs(there.u - wanted.u))
    end
    run:result("least", least, "m")
    run:result("reach", retina.zones[1].reach, "m")
    run:result("measured", retina.zones[1].least, "m")
    run:result("retina_moved", retina_moved, "m")
    run:result("rows", #run:samples("no_go_zones").time)
    run:result("alarms", #run:alarms())
  end,
}
)lua";

TEST(RetinaTargets, TheWayLeadsAroundANoGoZoneThatMovesWithTheRetina) {
  const std::string over = kOver;
  const std::string head = over.substr(0, over.find("    local servo <close>"));
  const Workplace place;
  place.write("around.lua", head + kAround);
  for (int seed = 1; seed <= 2; ++seed) {
    const Spoken spoken =
        place.vitreo("run ./around.lua --rig drifting_eye --json --seed " + std::to_string(seed));
    ASSERT_EQ(spoken.exit_code, 0) << spoken.out << spoken.err;
    const auto results = nlohmann::json::parse(spoken.out)["results"];
    const double least = results["least"], reach = results["reach"], moved = results["moved"];
    std::printf("seed %d: %.0f um from the zone's middle at least, %.0f um is the outline's edge\n",
                seed, least * 1e6, reach * 1e6);
    EXPECT_EQ(results["reached"], 1);
    EXPECT_GT(least, reach) << "the outline keeps out; a straight way passes at 0.3 mm";
    EXPECT_GT(results["measured"].get<double>(), 0) << "and the script knows it";
    EXPECT_LT(least, reach + 1e-3) << "it passes the zone, and does not stay away from it";
    EXPECT_GT(results["retina_moved"].get<double>(), 0.8e-3) << "the zone moves";
    EXPECT_EQ(results["refused"], 1);
    EXPECT_LT(moved, 0.3e-3) << "a target in the zone is refused before anything moves";
    EXPECT_GT(results["rows"], 100);
    EXPECT_EQ(results["alarms"], 0);
  }
}

TEST(RetinaTargets, ServoSupervisedReachesPointsThatMoveWithTheRetina) {
  const Workplace place;
  const Spoken spoken = place.vitreo(
      "run servo_supervised --rig drifting_eye feedback=color fixed_to=retina "
      "'points=1,0,0; -1,1,1' --json");
  ASSERT_EQ(spoken.exit_code, 0) << spoken.out << spoken.err;
  const auto results = nlohmann::json::parse(spoken.out)["results"];
  EXPECT_EQ(results["points_reached"], 2) << spoken.err;
  EXPECT_EQ(results["frames_on_map"], results["frames"]);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
