// Tolerances of an uncertain eye from Lua: on the axis, by focus over the field, by pose; and maps
// for observers who look askew.
// SPDX-License-Identifier: Apache-2.0
#include "tests/host/lua/interpreter/lua_bench.h"

namespace vitreo {
namespace {

class OpticsTolerance : public LuaBench {
 protected:
  /// `body` begins on line 3 of the file; it knows eye, soft (its lens' index 4 % more), mm, um,
  /// deg, near(a, b, within).
  Ended with_eye(const std::string& body) {
    return run(
        "local optics, units = require 'optics', require 'units' local mm, um, deg = units.mm, "
        "units.um, units.deg "
        "local eye = optics.prescription 'navarro_condensing' local soft = eye:with { "
        "['lens.index'] = 1.04 * "
        "eye:parameter 'lens.index' } local function near(a, b, within) if not (math.abs(a - b) <= "
        "within) then "
        "error(('%.9g is not %.9g'):format(a, b), 2) end end\n" +
        body);
  }
  void expect_fine(const std::string& body) { EXPECT_EQ(with_eye(body).error, "") << body; }
  void expect_refused(const std::string& body, const std::vector<std::string>& parts) {
    expect_all(with_eye(body).error, parts);
  }
};

// The figures are those of docs/optics.md, to half of the last digit that stands there.
TEST_F(OpticsTolerance, AnotherEyeThanBelievedCostsPlaceByFocusAndByPose) {
  expect_fine(
      "near(eye:field_error(eye, { max_angle = 30*deg }), 0.26*mm, 5*um) "
      "near(eye:field_error(eye), 0.55*mm, 5*um)\n"
      "near(eye:pose_error(eye), 0, 0.01*um) near(eye:axis_error(eye), 0, 1*um)");
  expect_fine(
      "assert(eye:field_error(eye, { measure = 'mean' }) < eye:field_error(eye, { measure = 'max' "
      "}))\n"
      "assert(eye:field_error(eye, { focus_error = 0.3*mm, measure = 'mean' }) > 0.3*mm)\n"
      "assert(eye:field_error(soft, { calibrated = true }) < eye:field_error(soft))\n"
      "assert(eye:axis_error(soft, { calibrated = true, method = 'minimum_norm' }) > "
      "eye:axis_error(soft, { calibrated "
      "= "
      "true }))");
  expect_fine(
      "local calibrated = eye:pose_error(soft, { calibrated = true }) assert(calibrated < 0.6 * "
      "eye:pose_error(soft))\n"
      "assert(eye:pose_error(soft, { calibrated = true, retinal_depth_error = 0.3*mm }) > "
      "calibrated)\n"
      "local robot = { shape = 'spheroid', half_length = 1*mm, radius = 0.5*mm }\n"
      "assert(eye:pose_error(soft, { robot = robot, depth_from = 2*mm }) ~= eye:pose_error(soft, { "
      "depth_from = 2*mm "
      "}))");
}

TEST_F(OpticsTolerance, EveryMethodIsRankedDrawnAndWeighed) {
  expect_fine(
      "local worst = eye:sensitivity { error = 'field', max_angle = 30*deg }[1] "
      "assert(worst.parameter == "
      "'lens.index')\n"
      "near(math.max(worst.minus, worst.plus), 3.78*mm, 5*um)");
  expect_fine(
      "local all = eye:sensitivity { error = 'pose' } assert(#all == 11 and all[1].parameter == "
      "'lens.index' and "
      "all[2].parameter == 'aqueous.thickness')\nnear(math.max(all[1].minus, all[1].plus), 342*um, "
      "0.5*um)");
  expect_fine(
      "local how = { error = 'pose', count = 20 } local before = eye:monte_carlo(how) "
      "how.calibrated = true\n"
      "local after = eye:monte_carlo(how) assert(before.count == 20 and after.median < "
      "before.median)");
  expect_fine(
      "local best = eye:variance_attribution { error = 'pose', count = 6, angles = 3, depths = 3, "
      "uncertainties = { "
      "['lens.index'] = 0.04, ['cornea.thickness'] = 0.06 } }\nassert(#best == 2 and "
      "best[1].parameter == 'lens.index' "
      "and best[1].reduction > 0.9)");
}

TEST_F(OpticsTolerance, UncertaintiesMayBeOnesOwn) {
  expect_fine(
      "local own = eye:sensitivity { uncertainties = { ['lens.index'] = 0.04, "
      "['condensing.thickness'] = 0.01 } }\n"
      "assert(#own == 2 and own[1].parameter == 'lens.index' and own[2].plus > 0)\n"
      "near(own[1].plus, eye:sensitivity()[1].plus, 1e-12)\n"
      "assert(eye:sensitivity { uncertainties = { ['lens.index'] = 0.01 } }[1].plus < own[1].plus "
      "/ 2)");
  expect_refused("eye:sensitivity { uncertainties = { ['lens.indx'] = 0.04 } }",
                 {"optical_system:sensitivity", "lens.ind"});
  expect_refused("eye:sensitivity { uncertainties = { ['lens.index'] = 'much' } }",
                 {"uncertainties: lens.index: wants"});
  expect_refused("eye:monte_carlo { uncertainties = {} }", {"uncertainties: wants names"});
}

TEST_F(OpticsTolerance, OptionsOfAnotherMethodAreRefusedByName) {
  expect_refused("eye:sensitivity { error = 'best' }",
                 {"error: wants axis or field or pose, got best"});
  expect_refused("eye:sensitivity { error = 'pose', focus_error = 1*mm }",
                 {"focus_error: the error by pose does not"});
  expect_refused("eye:sensitivity { max_angle = 20*deg }",
                 {"max_angle: the error by axis does not"});
  expect_refused("eye:pose_error(eye, { focus_error = 1*mm })", {"focus_error is not known"});
  expect_refused(
      "eye:pose_error(eye, { robot = { shape = 'cylinder', half_length = 1*mm, radius = 1*mm } })",
      {"robot: wants a spheroid"});
  expect_refused("eye:pose_error(eye, { depth_from = 5*mm, depth_to = 4*mm })",
                 {"depth_to: must be beyond depth_from"});
  expect_refused("eye:field_error(eye, { measure = 'worst' })",
                 {"measure: wants max or mean, got worst"});
  expect_refused("eye:field_error({})", {"optical_system:field_error: truth"});
}

TEST_F(OpticsTolerance, AMapForAnObserverWhoLooksAskewGoesThereAndBack) {
  // Within half a micrometer of the traced bundle, by the map's own promise; back to a nanometer.
  expect_fine(
      "local map = eye:wide_angle_map { max_angle = 20*deg, max_depth = 4*mm, microscope = { "
      "numerical_aperture = "
      "0.02, "
      "pupil_distance = 150*mm, decenter = { 0.3*mm, -0.2*mm }, tilt = { 2*deg, -1*deg } } }\n"
      "assert(not map:limits().symmetric)\n"
      "for _, point in ipairs { vector(2*mm, -1*mm, 3*mm), vector(-1.5*mm, 0.5*mm, 1.5*mm), "
      "vector(0, 0, 2*mm) } do\n"
      "  local image = assert(map:image(point)) assert((image - map:traced_image(point)):norm() < "
      "1*um)\n"
      "  assert((map:point(image) - point):norm() < 1e-9)\n"
      "  assert(map:locate(image, { focus_sigma = 50*um }).sigma.z > 20*um) end\n"
      "assert(map:image(vector(12*mm, 0, 3*mm)) == nil)\n"
      "local ok, why = pcall(map.isofocus, map, 10*mm) assert(not ok and tostring(why):find "
      "'microscope', why)");
  expect_fine(
      "local straight = { numerical_aperture = 0.02 } local aside = { numerical_aperture = 0.02, "
      "tilt = { 1*deg, 0 } "
      "}\n"
      "local function at(who) return eye:wide_angle_map({ max_angle = 15*deg, max_depth = 3*mm, "
      "microscope = who "
      "}):image("
      "vector(1*mm, 0, 2*mm)) end\n"
      "assert((at(straight) - at(aside)):norm() > 1*um)");
  expect_refused("eye:wide_angle_map { microscope = { tilt = { 2 } } }",
                 {"tilt: wants two numbers"});
  expect_refused("eye:wide_angle_map { microscope = { tilt = { 2, 0 } } }", {"tilt"});
}

}  // namespace
}  // namespace vitreo
