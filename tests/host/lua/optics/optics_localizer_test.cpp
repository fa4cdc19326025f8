// Localization and calibration as scripts see them, and long calculations that a stop ends.
// SPDX-License-Identifier: Apache-2.0
#include "tests/host/lua/interpreter/lua_bench.h"

namespace vitreo {
namespace VITREO_TEST_FILE {

class OpticsLocalizer : public LuaBench {
 protected:
  /// `body` begins on line 3 of the file; it knows eye, view (its localizer), robot, mm, um, deg,
  /// near(a, b, within).
  Ended with_eye(const std::string& body) {
    return run(
        "local optics, units = require 'optics', require 'units' local mm, um, nm, deg = units.mm, "
        "units.um, units.nm, units.deg local eye = optics.system { name = 'model_eye_5_3' } local "
        "view = "
        "eye:localizer { center = { 691.5, 517.5 } } local robot = { shape = 'spheroid', "
        "half_length = 1*mm, radius = 0.5*mm } local place = vector(2*mm, 1*mm, 5*mm) local "
        "function near(a, b, within) if not (math.abs(a - b) <= within) then error(('%.9g is not "
        "%.9g'):format(a, b), 2) end end\n" +
        body);
  }
  void expect_fine(const std::string& body) { EXPECT_EQ(with_eye(body).error, "") << body; }
  void expect_refused(const std::string& body, const std::vector<std::string>& parts) {
    expect_all(with_eye(body).error, parts);
  }
};

TEST_F(OpticsLocalizer, ABodyIsFoundWhereItWasShown) {
  expect_fine(
      "local seen = view:ellipse({ body = robot, position = place, axis = { 1, 0.2, 0.3 } })\n"
      "local pose = view:locate({ body = robot, ellipse = seen, axis = { 1, 0.2, 0.3 } })\n"
      "assert(pose.status == 'found' and (pose.position - place):norm() < 0.1*um and "
      "#pose.candidates == 1)\n"
      "assert(pose.sigma[3] > 10*um and pose.sigma[3] < 100*um and pose.sigma[4] == 0)\n"
      "near(pose.candidates[1].covariance[3][3], pose.sigma[3]^2, 1e-15)");
  expect_fine(
      "for _, body in ipairs { { shape = 'cylinder', half_length = 1*mm, radius = 0.3*mm }, { "
      "shape = 'ellipsoid', semi_axes = { 0.4*mm, 0.6*mm, 1*mm } } } do\n"
      "  local seen = view:ellipse({ body = body, position = place, axis = { 0, 1, 0 } })\n"
      "  local pose = view:locate({ body = body, ellipse = seen, position = place, axis = { 0, 1, "
      "0 } })\n"
      "  assert(pose.status == 'found' and (pose.position - place):norm() < 0.1*um, body.shape) "
      "end");
  expect_fine(
      "assert(view:ellipse({ body = robot, position = { 0, 0, -1*mm }, axis = { 1, 0, 0 } }) == "
      "nil)");
  expect_fine("assert(view:info().max_residual < 1*um and view:info().pixel == 14.3*um)");
}

TEST_F(OpticsLocalizer, ATiltHasTwoAnswersAndTheTurnAboutTheAxisNone) {
  expect_fine(
      "local seen = view:ellipse({ body = robot, position = place, axis = { 0.5, 0.7, 0.4 } })\n"
      "local pose = view:locate({ body = robot, ellipse = seen, rotate = true })\n"
      "assert(pose.status == 'ambiguous' and pose.position == nil and #pose.candidates == 2)\n"
      "local one = pose.candidates[1] assert(#one.unobservable == 1 and one.sigma[6] == math.huge "
      "and #one.orientation == 9)\n"
      "local again = view:locate({ body = robot, ellipse = seen, orientation = one.orientation, "
      "orientation_sigma = "
      "3*deg })\n"
      "assert(again.status == 'found' and (again.position - one.position):norm() < 5*um)");
  expect_fine(
      "local seen = view:ellipse({ body = robot, position = place, axis = { 1, 0, 0 } }) "
      "seen.semi_major "
      "= 3*seen.semi_major\n"
      "assert(view:locate({ body = robot, ellipse = seen, axis = { 1, 0, 0 } }).status == "
      "'misfit')");
}

TEST_F(OpticsLocalizer, PointsGiveSixDegreesOfFreedom) {
  expect_fine(
      "local points = {} for i, b in ipairs { { 1*mm, 0, 0 }, { -1*mm, 0.5*mm, 0 }, { 0, -1*mm, "
      "0.2*mm }, { 0, 0.3*mm, 1*mm }, { -0.4*mm, -0.6*mm, -0.8*mm } } do local at = "
      "view:pixel(place + vector(b[1], b[2], b[3]))\n"
      "points[i] = { body = b, u = at.u, v = at.v } end\n"
      "local pose = view:locate({ points = points, rotate = true })\n"
      "assert(pose.status == 'found' and (pose.position - place):norm() < 0.1*um) "
      "near(pose.candidates[1].axis.z, 1, 1e-6)");
  expect_refused("view:locate({ points = { { u = 1, v = 2 } }, rotate = true })",
                 {"points: 1: wants {body"});
  expect_refused("view:locate({ points = {}, rotate = true })",
                 {"localizer:locate: points: wants at least one"});
}

TEST_F(OpticsLocalizer, OneLookAtTheKnownRetinaMendsTheImageScale) {
  expect_fine(
      "local wrong = eye:localizer { center = { 691.5, 517.5 }, pixel = 14.3*um * 1.02 }\n"
      "local low = vector(0, 0, 1.5*mm) local seen = view:ellipse({ body = robot, position = low, "
      "axis = "
      "{ 1, 0, 0 } })\n"
      "local told = wrong:calibrate({ body = robot, ellipse = seen, axis = { 1, 0, 0 }, known_z = "
      "low.z })\n"
      "near(told.image_scale, 1/1.02, 1e-5) near(told.localizer:info().pixel, 14.3*um, 1e-10)\n"
      "local offset = wrong:calibrate({ body = robot, ellipse = seen, axis = { 1, 0, 0 }, known_z "
      "= low.z, "
      "correction = 'additive_offset' }).localizer\n"
      "local pose = offset:locate({ body = robot, ellipse = seen, axis = { 1, 0, 0 } }) "
      "near(pose.position.z, "
      "low.z, 1*um)\n"
      "local again = offset:calibrate({ body = robot, ellipse = seen, axis = { 1, 0, 0 }, known_z "
      "= "
      "low.z, correction = 'additive_offset' })\n"
      "near(again.offset:norm(), 0, 1*nm) near(again.localizer:locate({ body = robot, ellipse = "
      "seen, axis = { 1, 0, 0 } }).position.z, low.z, 1*um)");
  expect_refused(
      "view:calibrate({ body = robot, ellipse = { u = 1, v = 1, semi_major = 2, semi_minor = 1, "
      "angle = 0 }, axis = "
      "{ 1, 0, 0 }, known_z = 1*mm })",
      {"localizer:calibrate: observed"});
}

TEST_F(OpticsLocalizer, OneLookSaysWhichEyeIsTheMostProbable) {
  expect_fine(
      "local axis, low, high = { 1, 0, 0 }, vector(0, 0, 0.5*mm), vector(1*mm, 0, 6*mm)\n"
      "local by_eye, by_view, by_scale = 0, 0, 0\n"
      "for number = 1, 8 do\n"
      "local real = eye:sample({ number = number }):localizer { center = { 691.5, 517.5 } }\n"
      "local function shown(at) local seen = real:ellipse({ body = robot, position = at, axis = "
      "axis }) seen.sigma = 0.05 return seen end\n"
      "local look = { body = robot, ellipse = shown(low), axis = axis, known_z = low.z }\n"
      "local scaled = view:calibrate(look).localizer\n"
      "look.correction, look.axis_sigma, look.contour_sigma = 'eye', 1*deg, 0.05\n"
      "local told = view:calibrate(look)\n"
      "near(told.image_scale, 1, 0) near(told.offset:norm(), 0, 0) near(told.residual, 0, 60*um)\n"
      "assert(told.eye:info().parameters['lens.index'] ~= eye:info().parameters['lens.index'])\n"
      "local function off(one) return math.abs(one:locate({ body = robot, ellipse = shown(high), "
      "axis = axis }).position.z - high.z) end\n"
      "by_eye = by_eye + off(told.localizer) by_view = by_view + off(view)\n"
      "by_scale = by_scale + off(scaled)\nend\n"
      "assert(by_eye < by_scale and by_scale < by_view, by_eye .. ' ' .. by_scale .. ' ' .. "
      "by_view)");
  expect_refused(
      "view:calibrate({ body = robot, ellipse = view:ellipse({ body = robot, position = { 0, 0, "
      "1*mm "
      "}, axis = { 1, 0, 0 } }), axis = { 1, 0, 0 }, known_z = 1*mm, axis_sigma = 0.1 })",
      {"axis_sigma: goes with the correction eye alone"});
}

TEST_F(OpticsLocalizer, APlatesOutlineShowsWhereItIs) {
  expect_fine(
      "local plates = { shape = 'crossed_plates', half_length = 1*mm, radius = 0.5*mm, thickness = "
      "42*um }\n"
      "local place = vector(2*mm, 1*mm, 4*mm)\n"
      "local outline = view:outline({ body = plates, position = place, axis = { 1, 0.1, 0 } })\n"
      "assert(#outline == 64)\n"
      "local found = view:locate({ body = plates, outline = outline, axis = { 1, 0.1, 0 }, "
      "orientation_sigma = 2*deg, roll_sigma = 0.2 })\n"
      "near((found.candidates[1].position - place):norm(), 0, 1*nm)\n"
      "local pin = { shape = 'disc_with_needle', radius = 0.5*mm, thickness = 0.1*mm, "
      "needle_length "
      "= 1*mm, needle_radius = 0.05*mm }\n"
      "local six = view:locate({ body = pin, outline = view:outline({ body = pin, position = "
      "place, "
      "axis = { 1, 0.1, 0.5 } }), rotate = true })\n"
      "near((six.candidates[1].position - place):norm(), 0, 1*um)");
  expect_refused(
      "view:outline({ body = { shape = 'superquadric', semi_axes = { 1*mm, 1*mm, 1*mm }, "
      "exponent_along = 0.5, exponent_across = 0.5 }, position = { 0, 0, 4*mm }, axis = "
      "{ 1, 0, 0 } })",
      {"object: its outline is not in closed form"});
}

TEST_F(OpticsLocalizer, WrongCallsNameTheField) {
  const std::string seen = "{ u = 700, v = 500, semi_major = 50, semi_minor = 30, angle = 0 }";
  expect_refused(
      "view:locate({ body = { shape = 'sphere' }, ellipse = " + seen + ", axis = { 0, 0, 1 } })",
      {"shape: wants spheroid"});
  expect_refused("view:locate({ body = { shape = 'spheroid', radius = 1*mm }, ellipse = " + seen +
                     ", axis = { 0, 0, 1 } })",
                 {"half_length: is missing"});
  expect_refused("view:locate({ body = robot, ellipse = { u = 1 }, axis = { 0, 0, 1 } })",
                 {"localizer:locate: ellipse: v: is missing"});
  expect_refused("view:locate { body = robot, ellipse = " + seen + " }",
                 {"orientation: is needed"});
  expect_refused("view:locate({ body = robot, ellipse = " + seen + ", axis = { 0, 0, 0 } })",
                 {"axis: wants a direction"});
  expect_refused("view:locate({ body = robot, ellipse = " + seen + ", axes = { 0, 0, 1 } })",
                 {"axes is not known; did you mean axis?"});
  expect_refused(
      "local s = " + seen +
          " s.covariance = { 1, 2 } view:locate({ body = robot, ellipse = s, axis = { 0, 0, 1 } })",
      {"covariance: wants 25 numbers"});
  expect_refused("view:locate { body = robot, axis = { 0, 0, 1 } }",
                 {"localizer:locate: options: wants either ellipse, outline or points"});
  expect_refused("view:locate { ellipse = " + seen + ", axis = { 0, 0, 1 } }",
                 {"localizer:locate: body: is missing"});
  expect_refused("view:locate { body = robot, points = {} }", {"body: goes with ellipse"});
  expect_refused("eye:localizer { center = { 1 } }", {"center: wants two numbers"});
}

TEST_F(OpticsLocalizer, CamerasAndRetinasAreCalibratedFromPoints) {
  expect_fine(
      "local points = {} for i = 1, 9 do local x, y = (i % 3)*mm, (i // 3)*mm points[i] = { m = { "
      "x, y }, pixel = { 100 - x / (14*um), 200 + y / (14*um) } } end\n"
      "local camera = optics.fit_camera { points = points } near(camera.pixel, 14*um, 1e-12) "
      "near(camera.center[1], 100, 1e-6) near(camera.rotation, 0, 1e-9)\n"
      "assert(camera.pixel_sigma) local two = optics.fit_camera { points = { points[1], points[2] "
      "} }\n"
      "near(two.pixel, 14*um, 1e-12) assert(two.pixel_sigma == nil, 'nothing left to judge by')");
  expect_refused("optics.fit_camera { points = { { m = { 1 } } } }",
                 {"points: 1: m: wants two numbers"});
  expect_refused("optics.fit_camera { points = { { m = { 1, 2 }, px = { 1, 2 } } } }",
                 {"px is not known"});
  expect_fine(
      "local points = {} for i = 1, 40 do local r, a = i*0.2*mm, i * 2.4 points[i] = { "
      "r*math.cos(a), r*math.sin(a), r*r / (12*mm + math.sqrt(144*mm*mm - r*r)) } end\n"
      "local retina = optics.fit_retina { points = points } near(retina.radius, 12*mm, 1e-9) "
      "near(retina.conic, 0, 1e-6)\n"
      "local held = optics.fit_retina { points = points, conic = 0, on_axis = true }\n"
      "near(held.radius, 12*mm, 1e-9) assert(held.sigma.z and held.sigma.x == nil and "
      "held.sigma.conic == nil, 'what is held has no sigma')");
  expect_refused("optics.fit_retina { points = { { 0, 0 } } }", {"points: 1: wants a position"});
}

TEST_F(OpticsLocalizer, DepthOnTheAxisIsCalibratedOnTheRetinaOrByPoints) {
  expect_fine(
      "local law = eye:axis_law() near(law:depth(law:distance(3*mm)), 3*mm, 1e-12) "
      "assert(law:depth(-1) == nil)\n"
      "local soft = eye:with { ['lens.index'] = eye:info().parameters['lens.index'] * 1.01 }\n"
      "local sharp = soft:axis_law():distance(0) assert(math.abs((law:depth(sharp) or 1)) > "
      "0.1*mm)\n"
      "near(law:calibrate({ retina = sharp }).law:depth(sharp + 1e-9), 0, 1*um)\n"
      "local points = {} for i = 0, 4 do points[i + 1] = { depth = i*2*mm, distance = "
      "soft:axis_law():distance(i*2*mm) } end\n"
      "local told = law:calibrate { points = points } local fitted = told.law "
      "near(fitted:depth(points[3].distance), 4*mm, 1e-9) assert(told.rms_residual < 1e-9 and "
      "fitted:info().focal_length ~= law:info().focal_length)\n"
      "assert(told.focal_length_sigma > 0 and told.focal_length_sigma < 1*um)\n"
      "points[5], points[4] = nil, nil local three = law:calibrate { points = points }\n"
      "assert(three.focal_length_sigma == nil, 'three points leave nothing to judge by')");
  expect_refused("eye:axis_law():calibrate { retina = 9*mm, method = 'best' }",
                 {"method: wants sensor_shift"});
  expect_refused("eye:axis_law():calibrate { points = { { depth = 1*mm } } }",
                 {"points: 1: wants {depth"});
  expect_refused("eye:axis_law():calibrate {}", {"wants either retina or points"});
  expect_refused("eye:axis_law():calibrate { points = {}, method = 'minimum_norm' }",
                 {"method: is for the calibration on the retina"});
}

TEST_F(OpticsLocalizer, AnEyeIsEstimatedFromItsFoci) {
  expect_fine(
      "local navarro = optics.system { name = 'navarro_condensing' } local soft = navarro:with { "
      "['lens.index'] = 1.43 }\n"
      "local foci = {} for i = 0, 4 do foci[i + 1] = { depth = i*2*mm, distance = "
      "soft:axial_image(i*2*mm).distance } end\n"
      "local fit = navarro:estimate { foci = foci } local found, parameters = fit.eye, "
      "fit.parameters local before = navarro:axial_image().distance\n"
      "near(found:axial_image().distance, soft:axial_image().distance, 20*um) assert(fit.chi2 < 5 "
      "and #parameters == 11)\n"
      "for _, one in ipairs(parameters) do if one.parameter == 'lens.index' then "
      "assert(one.learned > 0.5 and one.sigma < one.prior_sigma) end end");
  expect_refused("eye:estimate { foci = {} }",
                 {"optical_system:estimate: foci: wants at least one"});
}

TEST_F(OpticsLocalizer, FocusLocalizesWithACovariance) {
  expect_fine(
      "local map = optics.system({ name = 'navarro_condensing' }):wide_angle_map() local point = "
      "vector(2*mm, 0, 4*mm)\n"
      "local image = map:image(point) local found = map:locate(image, { image_sigma = 10*um, "
      "focus_sigma = 100*um })\n"
      "assert((found.position - point):norm() < 1e-9 and found.sigma.z > 20*um and found.sigma.z < "
      "1*mm)\n"
      "near(map:locate(image, { image_sigma = 10*um, focus_sigma = 200*um }).sigma.z, "
      "2*found.sigma.z, 5*um)\n"
      "assert(map:locate({ 0, 0, 1 }) == nil)");
}

TEST_F(OpticsLocalizer, ALensIsDesignedInOneCall) {
  expect_fine(
      "local told = optics.system({ name = 'navarro_condensing_conic' }):optimize { variables = { "
      "'condensing.anterior.a4', ['condensing.anterior.conic'] = { -15, 0 } }, angles = { 0, "
      "10*deg, 20*deg } }\n"
      "assert(told.after.merit <= told.before.merit and #told.parameters == 2, told.reason) "
      "assert(told.system:info().name)");
  expect_refused("eye:optimize { variables = { 'condensing.anterior.b4' } }",
                 {"optical_system:optimize: "});
  expect_refused("eye:optimize { variables = { ['lens.index'] = 3 } }",
                 {"lens.index: wants {lower, upper}"});
  expect_refused("eye:optimize { variables = { 'condensing.anterior.a4' }, keeps = 'all' }",
                 {"keeps: wants"});
}

TEST_F(OpticsLocalizer, WhatToMeasureIsRankedAndAStopEndsIt) {
  expect_fine(
      "local best = optics.system({ name = 'navarro_condensing' }):error_analysis({ method = "
      "'variance_attribution', count = 60 }).parameters assert(best[1].parameter == 'lens.index' "
      "and best[1].reduction > 0.4 and best[1].count == 60 and #best == 11)");
  // The stopper is due at once, so it comes in while the calculation runs: a minute's worth of
  // eyes.
  const Ended ended = with_eye(
      "run:together(function() optics.system({ name = 'navarro_condensing' }):error_analysis { "
      "method = 'monte_carlo', count = 20000 } end, function() run:wait(0) error 'enough' end)");
  EXPECT_NE(ended.error.find("enough"), std::string::npos) << ended.error;
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
