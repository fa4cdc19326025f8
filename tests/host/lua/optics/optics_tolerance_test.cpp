// Tolerances of an uncertain eye from Lua: on the axis, by focus over the field, by pose; and maps
// for observers who look askew.
// SPDX-License-Identifier: Apache-2.0
#include "tests/host/lua/interpreter/lua_bench.h"

namespace vitreo {
namespace VITREO_TEST_FILE {

class OpticsTolerance : public LuaBench {
 protected:
  /// `body` begins on line 3 of the file; it knows eye, soft (its lens' index 4 % more), mm, um,
  /// deg, near(a, b, within).
  Ended with_eye(const std::string& body) {
    return run(
        "local optics, units = require 'optics', require 'units' local mm, um, deg = units.mm, "
        "units.um, units.deg local eye = optics.system { name = 'navarro_condensing' } local soft "
        "= eye:with { ['lens.index'] = 1.04 * eye:info().parameters['lens.index'] } local function "
        "near(a, b, within) if not (math.abs(a - b) <= within) then error(('%.9g is not "
        "%.9g'):format(a, b), 2) end end local function error_of(kind, truth, options) options = "
        "options or {} options.error, options.truth = kind, truth return "
        "eye:localization_error(options) end local function analyzed(method, options) options = "
        "options or {} options.method = method return eye:error_analysis(options) end local "
        "function sensitivity(options) return analyzed('one_at_a_time', options).parameters end\n" +
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
      "near(error_of('field', eye, { max_angle = 30*deg }), 0.26*mm, 5*um) near(error_of('field', "
      "eye), 0.55*mm, 5*um)\n"
      "near(error_of('pose', eye), 0, 0.01*um) near(error_of('axis', eye), 0, 1*um)");
  expect_fine(
      "assert(error_of('field', eye, { measure = 'mean' }) < error_of('field', eye, { measure = "
      "'max' }))\n"
      "assert(error_of('field', eye, { focus_error = 0.3*mm, measure = 'mean' }) > 0.3*mm)\n"
      "assert(error_of('field', soft, { calibrated = true }) < error_of('field', soft))\n"
      "assert(error_of('axis', soft, { calibrated = true, calibration_method = 'minimum_norm' }) > "
      "error_of('axis', soft, { calibrated = true }))");
  expect_fine(
      "local calibrated = error_of('pose', soft, { calibrated = true }) assert(calibrated < 0.6 * "
      "error_of('pose', soft))\n"
      "assert(error_of('pose', soft, { calibrated = true, retinal_depth_error = 0.3*mm }) > "
      "calibrated)\n"
      "local robot = { shape = 'spheroid', half_length = 1*mm, radius = 0.5*mm }\n"
      "assert(error_of('pose', soft, { robot = robot, depth_from = 2*mm }) ~= error_of('pose', "
      "soft, { depth_from = 2*mm }))");
}

TEST_F(OpticsTolerance, EveryMethodIsRankedDrawnAndWeighed) {
  expect_fine(
      "local worst = sensitivity({ error = 'field', max_angle = 30*deg })[1] "
      "assert(worst.parameter == 'lens.index')\n"
      "near(math.max(worst.minus, worst.plus), 3.78*mm, 5*um)");
  expect_fine(
      "local all = sensitivity({ error = 'pose' }) assert(#all == 11 and all[1].parameter == "
      "'lens.index' and all[2].parameter == 'aqueous.thickness')\nnear(math.max(all[1].minus, "
      "all[1].plus), 342*um, 0.5*um)");
  expect_fine(
      "local how = { error = 'pose', count = 20 } local before = analyzed('monte_carlo', how) "
      "how.calibrated = true\n"
      "local after = analyzed('monte_carlo', how) assert(before.count == 20 and after.median < "
      "before.median)");
  expect_fine(
      "local best = analyzed('variance_attribution', { error = 'pose', count = 6, angles = 3, "
      "depths = 3, uncertainties = { ['lens.index'] = 0.04, ['cornea.thickness'] = 0.06 } "
      "}).parameters\nassert(#best == 2 and best[1].parameter == 'lens.index' and "
      "best[1].reduction > 0.9)");
}

TEST_F(OpticsTolerance, UncertaintiesMayBeOnesOwn) {
  expect_fine(
      "local own = sensitivity({ uncertainties = { ['lens.index'] = 0.04, ['condensing.thickness'] "
      "= 0.01 } })\n"
      "assert(#own == 2 and own[1].parameter == 'lens.index' and own[2].plus > 0)\n"
      "near(own[1].plus, sensitivity()[1].plus, 1e-12)\n"
      "assert(sensitivity({ uncertainties = { ['lens.index'] = 0.01 } })[1].plus < own[1].plus / "
      "2)");
  expect_refused("sensitivity({ uncertainties = { ['lens.indx'] = 0.04 } })",
                 {"optical_system:error_analysis", "lens.ind"});
  expect_refused("sensitivity({ uncertainties = { ['lens.index'] = 'much' } })",
                 {"uncertainties: lens.index: wants"});
  expect_refused("analyzed('monte_carlo', { uncertainties = {} })", {"uncertainties: wants names"});
}

TEST_F(OpticsTolerance, OptionsOfAnotherMethodAreRefusedByName) {
  expect_refused("sensitivity({ error = 'best' })",
                 {"error: wants axis or field or pose, got best"});
  expect_refused("sensitivity({ error = 'pose', focus_error = 1*mm })",
                 {"focus_error: the error by pose does not"});
  expect_refused("sensitivity({ max_angle = 20*deg })", {"max_angle: the error by axis does not"});
  expect_refused("error_of('pose', eye, { focus_error = 1*mm })",
                 {"focus_error: the error by pose does not"});
  expect_refused(
      "error_of('pose', eye, { robot = { shape = 'cylinder', half_length = 1*mm, radius = 1*mm } "
      "})",
      {"robot: wants a spheroid"});
  expect_refused("error_of('pose', eye, { depth_from = 5*mm, depth_to = 4*mm })",
                 {"depth_to: must be beyond depth_from"});
  expect_refused("error_of('field', eye, { measure = 'worst' })",
                 {"measure: wants max or mean, got worst"});
  expect_refused("error_of('field', {})", {"optical_system:localization_error: truth"});
}

TEST_F(OpticsTolerance, AMapForAnObserverWhoLooksAskewGoesThereAndBack) {
  // Within half a micrometer of the traced bundle, by the map's own promise; back to a nanometer.
  expect_fine(
      "local map = eye:wide_angle_map { max_angle = 20*deg, max_depth = 4*mm, microscope = { "
      "numerical_aperture = 0.02, pupil_distance = 150*mm, decenter = { 0.3*mm, -0.2*mm }, tilt = "
      "{ 2*deg, -1*deg } } }\n"
      "assert(not map:info().symmetric)\n"
      "for _, point in ipairs { vector(2*mm, -1*mm, 3*mm), vector(-1.5*mm, 0.5*mm, 1.5*mm), "
      "vector(0, 0, 2*mm) } do\n"
      "  local image = assert(map:image(point)) assert((image - map:image(point, { traced = true "
      "})):norm() < "
      "1*um)\n"
      "  assert((map:locate(image).position - point):norm() < 1e-9)\n"
      "  assert(map:locate(image, { focus_sigma = 50*um }).sigma.z > 20*um) end\n"
      "assert(map:image(vector(12*mm, 0, 3*mm)) == nil)\n"
      "local ok, why = pcall(map.isofocus, map, 10*mm) assert(not ok and tostring(why):find "
      "'microscope', why)");
  expect_fine(
      "local straight = { numerical_aperture = 0.02 } local aside = { numerical_aperture = 0.02, "
      "tilt = { 1*deg, 0 } }\n"
      "local function at(who) return eye:wide_angle_map({ max_angle = 15*deg, max_depth = 3*mm, "
      "microscope = who }):image(vector(1*mm, 0, 2*mm)) end\n"
      "assert((at(straight) - at(aside)):norm() > 1*um)");
  expect_refused("eye:wide_angle_map { microscope = { tilt = { 2 } } }",
                 {"tilt: wants two numbers"});
  expect_refused("eye:wide_angle_map { microscope = { tilt = { 2, 0 } } }", {"tilt"});
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
