// Geometry of a rig's nominal model as plain numbers: what a drawing of the eye and of the cameras'
// views needs, also of a run that is over.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/rig/rig.h"

#include <nlohmann/json.hpp>

namespace vitreo {

/// m, world, in RunStart::rig["geometry"]: {"eye_x", "eye_y", "eye_z" (the retina's vertex),
/// "robot_semi_axis", "robot_semi_radius", and, where there is an eye, "retina_radius", "lens_z"}.
nlohmann::json geometry_of(const RigModel& model);

}  // namespace vitreo
