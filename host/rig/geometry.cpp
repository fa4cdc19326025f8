// SPDX-License-Identifier: Apache-2.0
#include "host/rig/geometry.h"

namespace vitreo {

nlohmann::json geometry_of(const RigModel& model) {
  nlohmann::json geometry = {{"eye_x", model.eye_in_world.x()},
                             {"eye_y", model.eye_in_world.y()},
                             {"eye_z", model.eye_in_world.z()},
                             {"robot_semi_axis", model.robot.semi_axis},
                             {"robot_semi_radius", model.robot.semi_radius}};
  if (model.plain_view) return geometry;  // a vessel without an eye
  geometry["retina_radius"] = model.eye.surfaces.front().radius;
  // Surfaces count from 1, the retina; the second is the lens' back.
  geometry["lens_z"] = model.eye_in_world.z() + model.eye.vertex(2);
  return geometry;
}

}  // namespace vitreo
