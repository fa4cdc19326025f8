// Bindings of the rig's model: its eye and its view as the loop believes them.
// SPDX-License-Identifier: Apache-2.0
#include "control/crossed_plates.h"
#include "host/lua/interpreter/values.h"
#include "host/lua/optics/bind_optics.h"
#include "host/lua/optics/classes.h"
#include "host/lua/optics/localizer_calls.h"
#include "host/lua/rig/bind_rig.h"
#include "host/rig/bench_settings.h"
#include "host/servo/robot_outline.h"
#include "optics/system/prescriptions.h"

#include <cmath>
#include <memory>
#include <string>
#include <utility>
#include <vector>

namespace vitreo::lua {
namespace {

// The prescription that the rig file names: the believed eye. The true one of a simulated rig
// cannot be asked for.
int rig_eye(Call& call) {
  push_system(call.L, optics::prescription(call.self<Rig>().model.eye_name));
  return 1;
}

// A copy of the loop's projection and image, as a localizer of its own: to calibrate it changes
// nothing of the loop until it is given to rig:servo.
int rig_view(Call& call) {
  const RigModel& model = call.self<Rig>().model;
  auto view = std::make_shared<localizer_calls::Localizer>();
  view->settings.projection = model.projection;
  view->settings.exact = model.exact;
  view->settings.image = model.top_image;
  view->eye = optics::prescription(model.eye_name);
  view->microscope = model.microscope;
  push_handle(call.L, localizer_class(), view);
  return 1;
}

std::string moves_by(const control::Robot& robot) {
  if (robot.helix) return "helix";
  return robot.tail ? "tail" : "gradient";
}

void set_uncertainty(ResultTable& table, const ViewUncertainty& known, bool measured) {
  table.number("size", known.size)
      .number("pixel", known.pixel)
      .number("tilt", known.tilt, "rad")
      .number("eye", known.eye, "m")
      .table("bench", [&](ResultTable& bench) {
        bench.text("places", measured ? "measured" : known.bench.by_hand ? "by_hand" : "known");
        for (const BenchKey& key : bench_keys())
          bench.number(key.name, known.bench.*key.sigma, std::string(key.bounds.unit).c_str());
      });
}

ResultField uncertainty_fields() {
  std::vector<ResultField> bench{
      {"places", "",
       "\"known\"; \"by_hand\": what was not measured is that of a bench set up by hand; "
       "\"measured\": by the calibration that model.chain names"}};
  for (const BenchKey& key : bench_keys())
    bench.push_back({key.name, std::string(key.bounds.unit), key.help});
  return {"uncertainty",
          "",
          "one sigma of what the rig file says of its own knowledge",
          {{"size", "", "of the robot, relative"},
           {"pixel", "", "of each camera's scale, relative"},
           {"tilt", "rad", "of each camera"},
           {"eye", "m", "of the eye's place along each axis"},
           {"bench", "", "of eye, condensing lens and microscope", std::move(bench)}}};
}

// The believed numbers alone, in the terms that optics and vision take; nothing here reads the
// plant of a simulated rig.
int rig_model(Call& call) {
  const RigModel& model = call.self<Rig>().model;
  ResultTable(call)
      .vector("eye_in_world", model.eye_in_world, "m")
      .number("retina_radius", model.eye.surfaces.front().radius, "m")
      .number("retina_conic", model.eye.surfaces.front().conic)
      .number("lens_depth", model.eye.vertex(2), "m")
      .number("pixel", model.top_image.pixel, "m")
      .numbers("center_px", {model.top_image.center_px.x(), model.top_image.center_px.y()})
      .number("side_pixel", model.side_pixel, "m")
      .numbers("side_center_px", {model.side_center_px.x(), model.side_center_px.y()})
      .table("microscope",
             [&](ResultTable& microscope) {
               const optics::Microscope& its = model.microscope;
               microscope.number("numerical_aperture", its.numerical_aperture)
                   .number("focus", its.focus, "m")
                   .numbers("decenter", {its.decenter.x(), its.decenter.y()}, "m")
                   .numbers("tilt", {its.tilt.x(), its.tilt.y()}, "rad");
               if (std::isfinite(its.pupil_distance))
                 microscope.number("pupil_distance", its.pupil_distance, "m");
             })
      .table("robot",
             [&](ResultTable& robot) {
               robot.text("shape", has_flat_ends(model.robot) ? "cylinder" : "spheroid")
                   .number("half_length", model.robot.semi_axis, "m")
                   .number("radius", model.robot.semi_radius, "m");
             })
      .table("identified",
             [&](ResultTable& robot) {
               robot.number("drag_along", model.robot.drag_along)
                   .number("drag_across", model.robot.drag_across)
                   .number("moment", model.robot.moment_factor)
                   .flag("hard", model.robot.hard);
             })
      .table("uncertainty",
             [&](ResultTable& known) {
               set_uncertainty(known, model.uncertainty, model.chain != nullptr);
             })
      .flag("plain_view", model.plain_view)
      .text("eye_name", model.eye_name)
      .text("eye_id", model.eye_id)
      .text("robot_name", model.robot.name)
      .text("robot_moves_by", moves_by(model.robot))
      .number("robot_plate_ratio", control::plate_ratio(model.robot))
      .text("focus_axis", model.focus_axis)
      .number("command_delay", model.command_delay, "s")
      .number("command_bandwidth", model.command_bandwidth, "Hz");
  return 1;
}

ResultField identified_fields() {
  return {"identified",
          "",
          "of the robot, by calibrate_robot: factors of what outline and volume say",
          {{"drag_along", "", ""},
           {"drag_across", "", ""},
           {"moment", "", ""},
           {"hard", "", "whether it is a permanent magnet"}}};
}

/// `robot` has the fields of a body, to be given to localizer and optical_system as it is.
Returned model_fields() {
  return {"table",
          {{"eye_in_world", "m", "the retina's vertex"},
           {"retina_radius", "m", ""},
           {"retina_conic", "", ""},
           {"lens_depth", "m", "of the lens before the retina"},
           {"pixel", "m", "of aerial image, top camera"},
           {"center_px", "", "{u, v} of the top camera's axis"},
           {"side_pixel", "m", "of the scene, side camera"},
           {"side_center_px", "", "{u, v} of the side camera's axis"},
           {"microscope",
            "",
            "",
            {{"numerical_aperture", "", ""},
             {"focus", "m", "from the last vertex"},
             {"decenter", "m", "{x, y} of its axis"},
             {"tilt", "rad", "about {x, y}"},
             {.name = "pupil_distance",
              .unit = "m",
              .help = "from the plane in focus to its pupil; nil: telecentric",
              .optional = true}}},
           {"robot",
            "",
            "a body, as the localizer takes it",
            {{"shape", "", ""}, {"half_length", "m", ""}, {"radius", "m", ""}}},
           identified_fields(),
           uncertainty_fields(),
           {"plain_view", "", "whether the top camera looks without an eye"},
           {"eye_name", "", "of the prescription that it believes"},
           {"eye_id", "", "of the eye that is there, as sample.eye of the rig file says"},
           {"robot_name", "", ""},
           {"robot_moves_by", "",
            "\"gradient\"; or by a field that turns (\"helix\"), that oscillates (\"tail\")"},
           {"robot_plate_ratio", "", "thickness over width of its crossed plates; 1: round"},
           {"focus_axis", "", "name of the stage's axis that moves the sensor along the light"},
           {"command_delay", "s", "of the coils"},
           {"command_bandwidth", "Hz", "of the coils"}}};
}

}  // namespace

std::vector<Binding> rig_model_rows() {
  return {{"eye",
           {},
           "optical_system",
           "the eye and lenses as the rig file says they are",
           rig_eye,
           "rig:eye()"},
          {"view",
           {},
           "localizer",
           "the top camera's view as the loop believes it; a calibration of it goes to rig:servo",
           rig_view,
           "rig:view()"},
          {"model", {}, model_fields(), "what the rig believes", rig_model, "rig:model()"}};
}

}  // namespace vitreo::lua
