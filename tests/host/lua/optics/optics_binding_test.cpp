// The optics as scripts see them: published numbers, properties, and what wrong calls are told.
// SPDX-License-Identifier: Apache-2.0
#include "tests/host/lua/interpreter/lua_bench.h"

#include <fstream>

namespace vitreo {
namespace VITREO_TEST_FILE {

class OpticsBinding : public LuaBench {
 protected:
  /// `body` begins on line 3 of the file; it knows eye, mm, um, deg and near(a, b, within).
  Ended with_eye(const std::string& body) {
    return run(
        "local optics, units = require 'optics', require 'units' local mm, um, deg = units.mm, "
        "units.um, units.deg local eye = optics.system { name = 'navarro_condensing' } local "
        "function near(a, b, within) if not (math.abs(a - b) <= within) then error(('%.9g is not "
        "%.9g'):format(a, b), 2) end end local function analyzed(method, options) options = "
        "options or {} options.method = method return eye:error_analysis(options) end\n" +
        body);
  }
  /// The script came to its end.
  void expect_fine(const std::string& body) { EXPECT_EQ(with_eye(body).error, "") << body; }
  void expect_refused(const std::string& body, const std::vector<std::string>& parts) {
    expect_all(with_eye(body).error, parts);
  }
};

TEST_F(OpticsBinding, TheModuleIsThereByNameAndByRequireAndNamesItsPrescriptions) {
  expect_fine("assert(optics == _G.optics)");
  expect_fine(
      "local known = {} for _, name in ipairs(optics.prescriptions()) do known[name] = true end\n"
      "assert(known.navarro and known.navarro_condensing and known.model_eye_5_3 and "
      "known.porcine)");
  expect_fine(
      "local i = eye:info() assert(i.name == 'navarro_condensing' and i.title:find('table 3.4') "
      "and i.source)");
  expect_refused("optics.system { name = 'navaro' }",
                 {"p.lua:3: optics.system: name: there is no 'navaro'; did you mean navarro?"});
  expect_refused("optics.sistem { name = 'navarro' }",
                 {"optics: there is no sistem; did you mean system?"});
  expect_refused("eye.first_order()", {"optical_system:first_order: is called with a colon"});
}

TEST_F(OpticsBinding, AProtocolMayChooseAmongPrescriptionsWhileItsFileIsOnlyRead) {
  const ProtocolDescription described = describe(
      "return { title = 't', parameters = { eye = { choices = optics.prescriptions(), default = "
      "'navarro' } }, run = function() end }");
  EXPECT_EQ(described.parameters.at(0).name, "eye");
  EXPECT_GE(described.parameters.at(0).choices.size(), 9u);
}

TEST_F(OpticsBinding, FirstOrderHasThePublishedNumbers) {
  // Table 3.4 by docs/optics.md; the tolerances are half of the last printed digit.
  expect_fine(
      "local f = eye:first_order() near(f.focal_length, 10.83323*mm, 5e-9) "
      "near(f.first_principal_point, 16.97261*mm, 5e-9) near(f.second_principal_point, "
      "-11.30774*mm, 5e-9)");
  expect_fine(
      "local i = eye:axial_image() near(i.distance, 7.85687*mm, 5e-9) near(i.magnification, "
      "-0.76906, 5e-6)");
  expect_fine("local a = eye:viewing().numerical_aperture near(a.oslo, 0.158998, 5e-7)");
  expect_fine(
      "local d = eye:viewing().depth_of_focus near(d.thesis, 95.1*um, 0.05*um) near(d.image_side, "
      "71.2*um, 0.05*um)");
  expect_fine("local d = eye:viewing().depth_of_field near(d.thesis, 157.8*um, 0.05*um)");
  expect_fine(
      "near(eye:viewing({ confusion = 12.8*um }).depth_of_focus.thesis, "
      "2*eye:viewing().depth_of_focus.thesis, 1e-12)");
  expect_fine(
      "local field = eye:viewing({ clear_radius = 10.5*mm, from_surface = 5 }).field_of_view "
      "near(field.angle, 80*deg, 1*deg) assert(#field.limit > 0 and eye:viewing().field_of_view == "
      "nil)");
  expect_fine(
      "local s = eye:seidel().total near(s.spherical, -15.3*um, 0.05*um) near(s.petzval, 29.1*um, "
      "0.05*um) near(s.distortion, -23.5*um, 0.05*um) assert(#eye:seidel().surfaces == 6)");
}

TEST_F(OpticsBinding, WrongFirstOrderCallsNameWhatIsWrong) {
  expect_refused("eye:axial_image(-1*mm)", {"optical_system:axial_image: depth"});
  expect_refused("eye:axial_image(0/0)",
                 {"optical_system:axial_image: depth: wants a number in m"});
  expect_refused("eye:viewing { confusion = 0 }", {"optical_system:viewing: confusion: wants"});
  expect_refused("eye:viewing { confusoin = 1*um }",
                 {"confusoin is not known; did you mean confusion?"});
  expect_refused("eye:viewing { observer_distance = 1*mm, clear_radius = 1*mm }",
                 {"wants either observer_distance or clear_radius"});
  expect_refused("eye:seidel { depth = 50*mm }", {"optical_system:seidel: ", "depth"});
}

TEST_F(OpticsBinding, PersonalEyesAreMadeByReplacingParameters) {
  expect_fine(
      "local mine = eye:with { ['cornea.anterior.radius'] = 7.8*mm, ['lens.index'] = 1.43 }\n"
      "assert(mine:info().parameters['lens.index'] == 1.43 and eye:info().parameters['lens.index'] "
      "== 1.42)\n"
      "assert(mine:axial_image().distance ~= eye:axial_image().distance)");
  expect_fine(
      "local relaxed = optics.system { name = 'navarro' } "
      "near(relaxed:with({ accommodation = 4 }):axial_image().distance, 0.26, 0.005)\n"  // as
                                                                                         // docs/optics.md
      "local mine = relaxed:with { accommodation = 4, ['lens.index'] = 1.43 }\n"
      "assert(mine:info().parameters['lens.index'] == 1.43)\n"  // what is given stands
      "assert(mine:info().parameters['lens.thickness'] > "
      "relaxed:info().parameters['lens.thickness'])");
  expect_refused("eye:with { accommodation = 11 }",
                 {"optical_system:with: accommodation", "0 and 10"});
  expect_refused("eye:with { ['lens.indx'] = 1.4 }",
                 {"optical_system:with: ", "lens.indx", "lens.index"});
  expect_refused("eye:with { ['lens.index'] = 'glass' }",
                 {"lens.index: wants a number, got a string"});
  expect_refused("eye:with { ['lens.index'] = 0.5 }", {"optical_system:with: ", "index"});
  expect_refused("eye:with { ['lens.thickness'] = 0/0 }", {"optical_system:with: ", "thickness"});
}

TEST_F(OpticsBinding, ColorsWavesAndTiltedSurfacesAreReached) {
  expect_fine(
      "local lens = optics.system { name = 'navarro_condensing' } local blue = "
      "lens:in_light(486.1e-9)\n"
      "assert(blue:info().parameters['lens.index'] > lens:info().parameters['lens.index'])\n"
      "assert(blue:prescription().wavelength == 486.1e-9 and not lens:prescription().wavelength)\n"
      "local wave = lens:wavefront { frequency = 5e4 }\n"
      "assert(wave.strehl > 0 and wave.strehl <= 1 and wave.rms > 0 and #wave.zernike == 28)\n"
      "assert(wave.mtf_tangential > 0 and wave.mtf_tangential < 1)\n"
      "local tilted = lens:with { ['lens.anterior.tilt_y'] = 0.05 }\n"
      "assert(tilted:prescription().rows[3].tilt_y == 0.05)\n"
      "assert(optics.system(tilted:prescription()):info().parameters['lens.anterior.tilt_y'] == "
      "0.05)");
  expect_fine(
      "local lens = optics.system { name = 'navarro_condensing' }\n"
      "local one = lens:point_spread { cells = 15, frequency = 5e4 }\n"
      "local three = lens:point_spread { wavelengths = { 589.3e-9, 486.1e-9, 656.3e-9 }, "
      "energies = { 1, 1, 1 }, cells = 15, half_width = one.half_width / 2, distance = "
      "one.distance }\n"
      "assert(#one.intensity == 15 and #one.intensity[15] == 15)\n"
      "assert(one.brightest > three.brightest, 'each color has its own focus')\n"
      "assert(one.mtf_tangential > 0 and one.mtf_tangential < 1 and not three.mtf_tangential)");
  expect_refused("eye:point_spread { wavelengths = { 5e-7 }, energies = { 1, 2 } }", {"energies"});
  expect_refused("eye:in_light(1.1e-6)", {"in_light", "navarro"});
  expect_refused("eye:with { ['lens.anterior.tilt_y'] = 2 }", {"optical_system:with: ", "tilt"});
}

TEST_F(OpticsBinding, ASystemGoesIntoATableAndComesBackToTheBit) {
  expect_fine(
      "for _, name in ipairs(optics.prescriptions()) do\n"
      "  local before = optics.system { name = name } local after = "
      "optics.system(before:prescription())\n"
      "  local a, b = before:info(), after:info() assert(a.title == b.title)\n"
      "  for name, value in pairs(a.parameters) do assert(b.parameters[name] == value, name) end\n"
      "  for name in pairs(b.parameters) do assert(a.parameters[name], name) end end");
  expect_fine(
      "local lens = optics.system { name = 'ball', stop = { surface = 2, radius = 1*mm }, rows = { "
      "{ radius = -12*mm, thickness = 20*mm }, { radius = 10*mm, thickness = 3*mm, index = 1.5 }, "
      "{ radius = -10*mm } } }\n"
      "assert(lens:first_order().focal_length > 0 and lens:info().name == 'ball')");
  expect_refused("optics.system {}",
                 {"optics.system: options: wants one of name, rows, zemax and file"});
  expect_refused("optics.system { rows = { { raduis = 1 } } }",
                 {"surface 1: raduis is not known; did you mean radius?"});
  expect_refused("optics.system { rows = { { radius = 'x' } } }",
                 {"surface 1: radius: wants a number, got a string"});
  expect_refused("optics.system { rows = { 5 } }",
                 {"rows: surface 1: wants a table, got a number"});
  expect_refused("local t = eye:prescription() t.stop.surface = 2.5 optics.system(t)",
                 {"stop.surface: wants the number"});
  expect_refused("local t = eye:prescription() t.rows[3].radius = 0 optics.system(t)",
                 {"optics.system: ", "radius"});
}

TEST_F(OpticsBinding, ZemaxFilesAreReadOnlyFromWhereScriptsLive) {
  const std::string ball =
      "VERS 140000 0 0\nMODE SEQ\nNAME A ball\nUNIT MM X W X CM MR CPMM\nENPD 2\nWAVM 1 0.5876 "
      "1\nPWAV 1\n"
      "SURF 0\n  TYPE STANDARD\n  CURV 0.0 0 0 0 0\n  DISZ 20\n"
      "SURF 1\n  STOP\n  TYPE STANDARD\n  CURV 0.1 0 0 0 0\n  GLAS ___BLANK 1 0 1.5 0 0 0 0 0 0 "
      "0\n  DISZ 3\n"
      "SURF 2\n  TYPE STANDARD\n  CURV -0.1 0 0 0 0\n  DISZ 10\n"
      "SURF 3\n  TYPE STANDARD\n  CURV 0.0 0 0 0 0\n  DISZ 0\n";
  std::ofstream(folder.path() / "lib" / "ball.zmx") << ball;
  std::ofstream(folder.path() / "secret.zmx") << ball;
  expect_fine(
      "local ball = optics.system { file = 'ball.zmx' } assert(ball:first_order().focal_length > "
      "9*mm)");
  expect_fine("local ball = optics.system { zemax = [[" + ball +
              "]] } assert(ball:info().parameters['surface_2.radius'] == 10*mm)");
  expect_refused("optics.system { file = '../secret.zmx' }",
                 {"optics.system: file: ../secret.zmx lies outside"});
  expect_refused("optics.system { file = '/etc/passwd' }",
                 {"file: /etc/passwd lies outside of the current folder"});
  expect_refused("optics.system { file = 'none.zmx' }", {"file: none.zmx: there is no such file"});
  expect_refused("optics.system { zemax = 'SURF 0\\n  TYPE TOROIDAL\\n' }",
                 {"optics.system: line 2: TYPE"});
  expect_refused("optics.system { zemax = '', direction = 'up' }",
                 {"direction: wants object_is_retina or image_is_retina"});
}

TEST_F(OpticsBinding, RaysGoOutAndComeBack) {
  expect_fine(
      "local out = eye:trace({ 0, 0, 0 }, { 0.02, 0, 1 }) assert(out.status == 'ok' and "
      "out.surface == nil)\n"
      "local back = eye:trace(out.origin + 5*mm*out.direction, -out.direction)\n"
      "local o, d = back.origin, back.direction assert(back.status == 'ok')\n"
      "near((o - d*(o.z/d.z)):norm(), 0, 1e-14)");  // rounding over 12 refractions of some mm
  expect_fine(
      "local lost = eye:trace({ 0, 0, 0 }, { 0.9, 0, 1 }) assert(lost.status ~= 'ok' and "
      "lost.surface >= 2)");
  expect_refused("eye:trace({ 0, 0, 0 }, { 0, 0, 0 })",
                 {"optical_system:trace: direction: wants a direction"});
  expect_refused("eye:localizer { microscope = { fokus = 1 } }",
                 {"fokus is not known; did you mean focus?"});
}

TEST_F(OpticsBinding, SpotsAndFieldCurvesAreThoseOfTheThesisSystem) {
  expect_fine(
      "local angles = {} for i = 0, 30 do angles[i + 1] = i*deg end\n"
      "local found = eye:field_curvature(angles) local curve = found.points "
      "near(found.span, 0.21*mm, 5*um)\n"  // over +-30 degrees
      "local spot = eye:spot { angle = 30*deg } near(spot.best_focus, curve[31].best_focus, 1e-9)\n"
      "near(spot.rms, curve[31].rms, 1e-9) assert(#spot.x == #spot.y and spot.transmitted > 0.9)\n"
      "assert(eye:spot { angle = 30*deg, distance = spot.best_focus + 1*mm }.rms > spot.rms)");
  expect_fine("local s = eye:spot { frequency = 0 } near(s.mtf_tangential, 1, 1e-12)");
  expect_fine("assert(eye:spot { depth = 0.5 } == nil and eye:point_at_field(0, 0.5) == nil)");
  expect_refused("eye:field_curvature { 'x' }", {"angles[1]: wants a number in rad, got a string"});
  expect_refused("eye:spot { angle = 2 }", {"optical_system:spot: angle: wants"});
}

TEST_F(OpticsBinding, TheWideAngleMapGoesThereAndBackAndSaysNothingOutside) {
  expect_fine(
      "local map = eye:wide_angle_map {} local worst = 0\n"
      "for angle = 0, 30, 5 do for depth = 0.1, 7.9, 1.3 do\n"
      "  local point = eye:point_at_field(angle*deg, depth*mm)\n"
      "  worst = math.max(worst, (map:locate(map:image(point, { traced = true })).position - "
      "point):norm()) end end\n"
      "near(worst, 0, 5*um)");  // the goal of the thesis' volume
  expect_fine(
      "local map = eye:wide_angle_map {} near(map:image({ 0, 0, 3*mm }).z, 9.722*mm, 1*um)\n"  // facts
                                                                                               // 2
      "assert(map:image({ 0, 0, -1*mm }) == nil and map:image({ 0, 0, 18*mm }) == nil)\n"
      "assert(map:locate({ 0, 0, 100*mm }) == nil and map:info().max_angle >= 30*deg)");
  expect_fine(
      "local map = eye:wide_angle_map { microscope = { focus = 9*mm }, max_angle = 30*deg }\n"
      "assert(map:image(eye:point_at_field(10*deg, 2*mm)))");
  expect_refused("eye:wide_angle_map { max_angle = 0 }",
                 {"optical_system:wide_angle_map: max_angle: wants"});
  expect_fine(
      "local map = eye:wide_angle_map { microscope = { focus = 9*mm, decenter = { 1*mm, 0 } }, "
      "max_angle = 25*deg }\n"
      "assert(map:locate(map:image(eye:point_at_field(10*deg, 2*mm))))");
  expect_refused("eye:wide_angle_map { microscope = { tilt = { 0.6, 0 } } }",
                 {"wide_angle_map: ", "tilt"});
  expect_refused("eye:wide_angle_map({}):image('x')",
                 {"wide_angle_map:image: point: wants a position {x, y, z} in m"});
}

TEST_F(OpticsBinding, IsofocusSurfacesAndIsopixelCurvesHoldWhatTheyAreNamedAfter) {
  expect_fine(
      "local map = eye:wide_angle_map {} local c = map:isofocus(10*mm) local r, z = c.r, c.z "
      "assert(#r == #z and #r > 20)\n"
      "for i = 1, #r do near(map:image({ r[i], 0, z[i] }).z, 10*mm, 10e-9) end\n"
      "c = map:isopixel(3*mm, 11) r, z = c.r, c.z assert(#r > 5)\n"
      "for i = 1, #r do near(math.abs(map:image({ r[i], 0, z[i] }).x), 3*mm, 10e-9) end\n"
      "assert(#map:isofocus(50*mm).r == 0)");
  expect_fine(
      "local t = eye:wide_angle_map({}):thesis_curves() assert(#t.radius == 4 and #t.surfaces >= 5 "
      "and t.curves[1].height > 0)");
}

TEST_F(OpticsBinding, DepthFromFocusIsCalibratedOnTheRetina) {
  expect_fine("near(eye:axis_law():depth(eye:axial_image(3*mm).distance), 3*mm, 1e-12)");
  expect_fine(
      "local patient = eye:with { ['lens.index'] = 1.42*1.03 }\n"  // docs/optics.md: 2.96 mm
                                                                   // before, 0.11 after
      "local seen, retina = patient:axial_image(4*mm).distance, patient:axial_image().distance\n"
      "near(eye:axis_law():calibrate({ retina = retina }).law:depth(seen), 4*mm, 0.12*mm)");
  expect_fine("assert(eye:axis_law():depth(1*mm) == nil)");
}

TEST_F(OpticsBinding, ToleranceRanksTheIndexOfTheLensFirst) {
  expect_fine(
      "local list = analyzed('one_at_a_time').parameters assert(list[1].parameter == "
      "'lens.index')\n"
      "near(list[1].plus, 4.18*mm, 0.01*mm) near(list[1].minus, 2.85*mm, 0.01*mm)\n"  // docs/optics.md
      "assert(analyzed('one_at_a_time', { calibrated = true }).parameters[1].plus < 0.5*mm)");
  expect_fine(
      "local a, b = analyzed('monte_carlo', { count = 20 }), analyzed('monte_carlo', { count = 20 "
      "})\n"
      "assert(a.count + a.failed == 20 and a.median == b.median and a.max >= a.median)");
}

TEST_F(OpticsBinding, TheLayoutGoesIntoTheRecordAsADrawing) {
  expect_fine(
      "run:picture { title = 'Layout', svg = eye:layout { angles = { 0, 20*deg }, title = 'An eye' "
      "} }");
  ASSERT_EQ(recorder.drawings().size(), 1u);
  expect_all(recorder.drawings().at(0).svg, {"<svg xmlns=", "An eye", "aerial image", "</svg>"});
  expect_refused("run:picture { title = 'x', svg = 'text' }",
                 {"run:picture: svg: wants a whole SVG document"});
  expect_refused("run:picture { title = 'x', svg = eye:layout(), note = 'n' }",
                 {"run:picture: note: does not go with svg"});
  expect_refused("run:picture { title = 'x' }", {"run:picture: image: is missing"});
  expect_refused("eye:layout { angles = { 2 } }", {"optical_system:layout: "});
}

TEST_F(OpticsBinding, HelpTellsOfTheModuleAndItsObjects) {
  expect_all(prompt("help()\n"), {"optical_system", "wide_angle_map", "optics.prescriptions()"});
  expect_all(prompt("help('optics')\n"), {"optics.fit_retina({points, conic, on_axis})"});
  expect_all(prompt("help('localizer:locate')\n"),
             {"body: a table, may be left out", "body.shape: a string", "ellipse.u: a number"});
  expect_all(prompt("help('optics.system')\n"), {"one's own by rows"});
  expect_all(prompt("help(optics.system { name = 'navarro' })\n"),
             {"optical_system:wide_angle_map(", "optical_system:spot("});
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
