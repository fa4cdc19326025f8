// Visibility check: whether the top camera can see a path, before a robot is sent along it.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/trajectory.h"
#include "devices/roles/camera.h"
#include "host/rig/rig.h"

namespace vitreo {

/// Throws std::invalid_argument naming the first position of the path (world) that the model's
/// optics show outside of the camera's picture, or not at all. `image_scale`: of the view's
/// calibration.
void check_visible(const RigModel& model, const CameraInfo& camera, double image_scale,
                   const control::Trajectory& path);

}  // namespace vitreo
