// The module `control` from Lua.
// SPDX-License-Identifier: Apache-2.0
#include "tests/host/lua/lua_bench.h"

namespace vitreo {
namespace {

class ControlBinding : public LuaBench {};

TEST_F(ControlBinding, EveryTrajectoryBeginsAndEndsAtRestWhereItShould) {
  const Ended end =
      run("local mm = require('units').mm\n"
          "local function check(t, from, to)\n"
          "  local p, v = t:at(0) assert((p - from):norm() < 1e-9 and v:norm() < 1e-9)\n"
          "  p, v = t:at(t:duration()) assert((p - to):norm() < 1e-9 and v:norm() < 1e-9)\n"
          "  local fastest = 0\n"
          "  for i = 0, 200 do local _, w = t:at(t:duration() * i / 200) fastest = math.max(fastest, w:norm()) end\n"
          "  assert(fastest <= 0.5 * mm * 1.001, fastest)\n"
          "end\n"
          "local a, b = vector(0, 0, 0), vector(3 * mm, 0, 0)\n"
          "check(control.point(b), b, b) check(control.line(a, b), a, b)\n"
          "check(control.rectangle(a, b, vector(0, 0, 2 * mm)), a, a)\n"
          "check(control.circle(a, b, vector(0, 3 * mm, 0), { turns = 2 }), b, b)\n"
          "check(control.waypoints({ a, b, { 0, 0, mm } }), a, vector(0, 0, mm))\n"
          "check(control.spline({ a, b, { 0, 0, mm } }), a, vector(0, 0, mm))\n"
          "local s = control.spiral { turns = 1, height = 2 * mm } assert(s:length() > 2 * mm)\n"
          "assert(math.abs(control.line(a, b, { speed = 1e-3, acceleration = 1 }):duration() - 3) < 0.01)");
  EXPECT_EQ(end.error, "");
}

TEST_F(ControlBinding, AllocationMakesWhatWasWantedAndTheFieldSaysSo) {
  const Ended end =
      run("local mT, uN = require('units').mT, 1e-6\n"
          "local model = control.octomag() assert(model:coils() == 8 and model:valid_at({ 0, 0, 0 }))\n"
          "local wanted = { position = { 1e-3, 0, 0 }, field = { 10 * mT, 0, 0 }, force = { 2 * uN, 0, 1 * uN } }\n"
          "local got = model:allocate(wanted)\n"
          "local b, gradient = model:field(wanted.position, got.currents)\n"
          "assert((b - wanted.field):norm() < 1e-9 and (got.force - wanted.force):norm() < 1e-12)\n"
          "assert(math.abs(gradient[1][1] + gradient[2][2] + gradient[3][3]) < 1e-9, 'no divergence')\n"
          "wanted.dead = { 2 } local lame = model:allocate(wanted)\n"
          "assert(lame.currents[2] == 0 and lame.headroom < got.headroom and not lame.limited)\n"
          "assert(got.condition > 1 and got.condition < 13 and model:instability({ 0, 0, 0 }, got.currents) > 0)\n"
          "local map = model:workspace_map { points = { 2, 1, 1 }, high = { 5e-3, 0, 0 }, low = { 0, 0, 0 } }\n"
          "assert(#map == 2 and map[1].field > 40 * mT and map[1].force > 0.3)\n"
          "local robot = control.robot('ndfeb_cylinder_1mm') assert(math.abs(robot.net_weight - 12.6e-6) < 0.2e-6)\n"
          "assert(#control.robots() == 4)");
  EXPECT_EQ(end.error, "");
}

TEST_F(ControlBinding, BadInputIsNamed) {
  expect_all(run("control.lin({0, 0, 0}, {0, 0, 1})").error, {"there is no lin; did you mean line?"});
  expect_all(run("control.waypoints({ 1 })").error, {"points: number 1 is not a position"});
  expect_all(run("control.robot('coni')").error, {"coni_2mm"});
  expect_all(run("control.field_calibration('Coil_List: [')").error, {"line 1"});
  expect_all(run("control.octomag():field({ 0, 0, 0 }, { 1, 2 })").error, {"currents: wants 8 numbers"});
  expect_all(run("control.octomag():allocate { position = { 0, 0, 0 }, field = { 0, 0, 0 } }").error, {"field: wants"});
  expect_all(run("control.circle({ 0, 0, 0 }, { 1e-3, 0, 0 }, { 0, 2e-3, 0 })").error, {"control.circle"});
}

}  // namespace
}  // namespace vitreo
