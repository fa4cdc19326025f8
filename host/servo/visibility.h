// Visibility check: whether the top camera can see a path, before a robot is sent along it.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/trajectory.h"
#include "devices/roles/camera.h"
#include "host/rig/rig.h"

#include <Eigen/Core>

namespace vitreo {

/// How a loop takes the top camera's picture.
struct SightedAs {
  double image_scale = 1;           // of the view's calibration
  Eigen::Vector3d offset{0, 0, 0};  // m, that is added to what the optics find
  Eigen::Vector3d axis{1, 0, 0};    // of the robot, unit, world
};

/// Throws std::invalid_argument naming the first position of the path (world) whose robot the
/// model's optics show outside of the camera's picture (its middle), or not whole, or not at all.
void check_visible(const RigModel& model, const CameraInfo& camera, const SightedAs& sighted,
                   const control::Trajectory& path);

}  // namespace vitreo
