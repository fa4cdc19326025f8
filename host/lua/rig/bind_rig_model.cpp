// What the rig believes of its eye and its view.
// SPDX-License-Identifier: Apache-2.0
#include "host/lua/interpreter/values.h"
#include "host/lua/optics/bind_optics.h"
#include "host/lua/optics/classes.h"
#include "host/lua/optics/localizer_calls.h"
#include "host/lua/rig/bind_rig.h"
#include "optics/system/prescriptions.h"

#include <memory>

namespace vitreo::lua {
namespace {

int rig_eye(Call& call) {
  push_system(call.L, optics::prescription(call.self<Rig>().model.eye_name));
  return 1;
}

int rig_view(Call& call) {
  const RigModel& model = call.self<Rig>().model;
  auto view = std::make_shared<localizer_calls::Localizer>();
  view->settings.projection = model.projection;
  view->settings.exact = model.exact;
  view->settings.image = model.top_image;
  push_handle(call.L, localizer_class(), view);
  return 1;
}

void set_place(lua_State* L, const char* name, const Eigen::Vector3d& place) {
  push_vector(L, place);
  lua_setfield(L, -2, name);
}

void set_pair(lua_State* L, const char* name, const Eigen::Vector2d& pair) {
  push_numbers(L, {pair.x(), pair.y()});
  lua_setfield(L, -2, name);
}

int rig_model(Call& call) {
  const RigModel& model = call.self<Rig>().model;
  push_fields(call.L, {{"pixel", model.top_image.pixel},
                       {"side_pixel", model.side_pixel},
                       {"retina_radius", model.eye.surfaces.front().radius},
                       {"retina_conic", model.eye.surfaces.front().conic},
                       {"lens_depth", model.eye.vertex(2)},
                       {"command_delay", model.command_delay},
                       {"command_bandwidth", model.command_bandwidth}});
  set_place(call.L, "eye_in_world", model.eye_in_world);
  set_pair(call.L, "center_px", model.top_image.center_px);
  set_pair(call.L, "side_center_px", model.side_center_px);
  push_fields(call.L, {{"numerical_aperture", model.microscope.numerical_aperture},
                       {"focus", model.microscope.focus}});
  lua_setfield(call.L, -2, "microscope");
  push_fields(call.L,
              {{"half_length", model.robot.semi_axis}, {"radius", model.robot.semi_radius}});
  lua_pushstring(call.L, "spheroid");
  lua_setfield(call.L, -2, "shape");
  lua_setfield(call.L, -2, "robot");
  lua_pushstring(call.L, model.robot.name.c_str());
  lua_setfield(call.L, -2, "robot_name");
  return 1;
}

}  // namespace

std::vector<Binding> rig_model_rows() {
  return {
      {"eye", {}, "optical_system", "the eye and lenses as the rig file says they are", rig_eye},
      {"view",
       {},
       "localizer",
       "the top camera's view as the loop believes it; a calibration of it goes to rig:servo",
       rig_view},
      {"model",
       {},
       "table",
       "what the rig believes: eye_in_world in m, retina_radius in m, retina_conic, lens_depth in "
       "m, microscope "
       "{focus in m, numerical_aperture}, pixel in m, center_px, side_pixel in m, side_center_px, "
       "robot (a body for "
       "the localizer: radius in m, half_length in m), robot_name, command_delay in s, "
       "command_bandwidth in Hz",
       rig_model}};
}

}  // namespace vitreo::lua
