// The module `control` from Lua.
// SPDX-License-Identifier: Apache-2.0
#include "tests/host/lua/interpreter/lua_bench.h"

namespace vitreo {
namespace VITREO_TEST_FILE {

class ControlBinding : public LuaBench {};

TEST_F(ControlBinding, EveryTrajectoryBeginsAndEndsAtRestWhereItShould) {
  const Ended end = run(
      "local mm = require('units').mm\n"
      "local function check(t, from, to)\n"
      "  local r = t:at(0) assert((r.position - from):norm() < 1e-9 and r.velocity:norm() < 1e-9)\n"
      "  local duration = t:info().duration\n"
      "  r = t:at(duration) assert((r.position - to):norm() < 1e-9 and r.velocity:norm() < "
      "1e-9)\n"
      "  local fastest = 0\n"
      "  for i = 0, 200 do fastest = "
      "math.max(fastest, t:at(duration * i / 200).velocity:norm()) end\n"
      "  assert(fastest <= 0.5 * mm * 1.001, fastest)\n"
      "end\n"
      "local a, b = vector(0, 0, 0), vector(3 * mm, 0, 0)\n"
      "check(control.line { from = a, to = b }, a, b)\n"
      "check(control.rectangle { corner = a, side = b, up = { 0, 0, 2 * mm } }, a, a)\n"
      "check(control.circle { center = a, first = b, second = { 0, 3 * mm, 0 }, turns = 2 }, b, "
      "b)\n"
      "check(control.waypoints { points = { a, b, { 0, 0, mm } } }, a, vector(0, 0, mm))\n"
      "check(control.spline { points = { a, b, { 0, 0, mm } } }, a, vector(0, 0, mm))\n"
      "local s = control.spiral { turns = 1, height = 2 * mm } assert(s:info().length > 2 * mm)\n"
      "assert(math.abs(control.line({ from = a, to = b, speed = 1e-3, acceleration = 1 "
      "}):info().duration - 3) "
      "< 0.01)");
  EXPECT_EQ(end.error, "");
}

TEST_F(ControlBinding, AllocationMakesWhatWasWantedAndTheFieldSaysSo) {
  const Ended end = run(
      "local mT, uN = require('units').mT, 1e-6\n"
      "local model = control.field_model({ name = 'octomag' }) local info = model:info()\n"
      "assert(info.coils == 8 and info.region == nil and info.background:norm() == 0)\n"
      "local wanted = { position = { 1e-3, 0, 0 }, field = { 10 * mT, 0, 0 }, force = { 2 * uN, 0, "
      "1 * uN } }\n"
      "local got = model:allocate(wanted)\n"
      "local made = model:field { position = wanted.position, currents = got.currents, robot = "
      "'coni_2mm' } local gradient = made.gradient\n"
      "assert((made.field - wanted.field):norm() < 1e-9 and (got.force - wanted.force):norm() < "
      "1e-12)\n"
      "assert(math.abs(gradient[1][1] + gradient[2][2] + gradient[3][3]) < 1e-9, 'no divergence')\n"
      "wanted.dead = { 2 } local lame = model:allocate(wanted)\n"
      "assert(lame.currents[2] == 0 and lame.headroom < got.headroom and not lame.limited)\n"
      "assert(got.condition > 1 and got.condition < 13 and made.instability > 0)\n"
      "assert(model:field({ position = { 0, 0, 0 }, currents = got.currents }).instability == "
      "nil)\n"
      "local map = model:workspace_map { points = { 2, 1, 1 }, high = { 5e-3, 0, 0 }, low = { 0, "
      "0, 0 } }\n"
      "assert(#map == 2 and map[1].field > 40 * mT and map[1].force > 0.3)\n"
      "local robot = control.robot { name = 'ndfeb_cylinder_1mm' } "
      "assert(math.abs(robot.net_weight - "
      "12.6e-6) < 0.2e-6)\n"
      "assert(#control.robots() == 6)");
  EXPECT_EQ(end.error, "");
}

constexpr const char* kReadings =
    "local model, readings = control.field_model { name = 'octomag', background = { 3e-5, 0, -4e-5 "
    "} "
    "}, {}\n"
    "for n = 1, 90 do\n"
    "  local place = vector(math.random() - 0.5, math.random() - 0.5, math.random() - 0.5) * 0.02\n"
    "  local currents = {} for k = 1, 8 do currents[k] = 8 * math.random() - 4 end\n"
    "  local noise = vector(math.random() - 0.5, math.random() - 0.5, math.random() - 0.5) * 2e-5\n"
    "  readings[n] = { position = place, currents = currents, field = model:field({ "
    "position = place, currents = currents }).field + noise }\n"
    "end\n";

TEST_F(ControlBinding, CoilsAreCalibratedFromProbeReadingsWithAReportOfWhatIsLeftOver) {
  const Ended end = run(
      std::string(kReadings) +
      "readings[17].field = readings[17].field + vector(1e-4, 0, 0)\n"
      "local report = control.fit_field_model { readings = readings, sources = 'dipoles' } local "
      "fitted = report.model\n"
      "assert(report.converged and report.readings == 90 and report.worst_reading == 17, "
      "report.worst_reading)\n"
      "assert(report.residual_rms > 3e-6 and report.residual_rms < 1.2e-5, report.residual_rms)\n"
      "assert(report.residual_largest > 4e-5 and report.residual_relative < 1e-3)\n"
      "assert((report.background - vector(3e-5, 0, -4e-5)):norm() < 1e-5)\n"
      "local at = { position = vector(2e-3, -3e-3, 1e-3), currents = { 1, 2, 3, 4, -1, -2, -3, -4 "
      "} "
      "}\n"
      "local told, truth = fitted:field(at).field, model:field(at).field\n"
      "assert((told - truth):norm() < 1e-3 * truth:norm())\n"
      "local rest = control.fit_field_model { readings = readings, sources = 'multipoles', order = "
      "1 "
      "} local many, box = rest.model, rest.model:info().region\n"
      "assert(rest.residual_rms < 1.2e-5 and box.high.x > 5e-3 and box.high.x < 0.01)\n"
      "assert((many:info().background - rest.background):norm() == 0)\n"
      // written down and read again it is the same, the background with it
      "local again = control.field_model { calibration = many:to_yaml { name = 'ours' } }\n"
      "assert((again:field(at).field - many:field(at).field):norm() < 1e-12)\n"
      "box = { low = { -0.01, -0.01, -0.01 }, high = { 0.01, 0.01, 0.01 } }\n"
      "again = control.field_model { calibration = fitted:to_yaml(box) }\n"
      "assert((again:field(at).field - told):norm() < 1e-12 and again:info().region.high.x == "
      "0.01)\n"
      "at.position = { 0.02, 0, 0 } again:field(at)");
  expect_all(end.error, {"field_model:field: ", "outside"});
}

TEST_F(ControlBinding, ReadingsThatSayTooLittleAreNamed) {
  const std::string some = kReadings;
  expect_all(run(some + "readings[3].field = nil control.fit_field_model { readings = readings, "
                        "sources = 'dipoles' }")
                 .error,
             {"readings: 3: field: wants"});
  expect_all(run(some + "readings[5].currents = { 1 } control.fit_field_model { readings = "
                        "readings, sources = 'dipoles' }")
                 .error,
             {"readings: 5: currents: wants 8 numbers"});
  expect_all(run(some + "readings[4].place = 1 control.fit_field_model { readings = readings, "
                        "sources = 'dipoles' }")
                 .error,
             {"readings: 4: ", "place"});
  expect_all(run(some + "readings[2].position = { 0 / 0, 0, 0 } control.fit_field_model { readings "
                        "= readings, sources = 'multipoles' }")
                 .error,
             {"readings: 2: position"});
  expect_all(run(some + "for _, r in ipairs(readings) do r.currents[3] = 0 end "
                        "control.fit_field_model { readings = readings, sources = 'dipoles' }")
                 .error,
             {"coil 3 never had a current"});
  expect_all(run("control.fit_field_model { readings = {}, sources = 'dipoles' }").error,
             {"readings: 0 given, at least 17 needed"});
  expect_all(
      run(some + "local many = control.fit_field_model { readings = readings, sources = "
                 "'multipoles', order = 1 } control.fit_field_model { readings = readings, sources "
                 "= 'dipoles', start = many.model }")
          .error,
      {"start: wants a model of dipoles"});
  expect_all(
      run(some + "control.fit_field_model { readings = readings, sources = 'dipoles', order = 2 }")
          .error,
      {"order: is for multipoles"});
  expect_all(run("control.field_model({ name = 'octomag' }):to_yaml()").error, {"low, high"});
}

TEST_F(ControlBinding, BadInputIsNamed) {
  expect_all(run("control.lin({0, 0, 0}, {0, 0, 1})").error,
             {"there is no lin; did you mean line?"});
  expect_all(run("control.waypoints { points = { 1 } }").error,
             {"points: number 1 is not a position"});
  expect_all(run("control.robot { name = 'coni' }").error, {"coni_2mm"});
  expect_all(run("control.field_model { calibration = 'Coil_List: [' }").error, {"line 1"});
  expect_all(run("control.field_model({ name = 'octomag' }):field { position = { 0, 0, 0 }, "
                 "currents = { 1, 2 } }")
                 .error,
             {"currents: wants 8 numbers"});
  expect_all(run("control.field_model({ name = 'octomag' }):allocate { position = { 0, 0, 0 }, "
                 "field = { 0, 0, 0 } }")
                 .error,
             {"field: wants"});
  expect_all(run("control.circle { center = { 0, 0, 0 }, first = { 1e-3, 0, 0 }, second = { 0, "
                 "2e-3, 0 } }")
                 .error,
             {"control.circle"});
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
