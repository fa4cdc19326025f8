// The rig: which instrument plays which role, and what the host believes about the optics, the coils and the robot.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/coil_field.h"
#include "control/robot.h"
#include "devices/camera.h"
#include "devices/field_probe.h"
#include "devices/lens_mover.h"
#include "devices/rotation_stage.h"
#include "devices/sample_handler.h"
#include "devices/stage.h"
#include "host/interlock.h"
#include "optics/observer.h"
#include "optics/pose.h"

#include <Eigen/Core>

#include <optional>
#include <string>
#include <vector>

namespace vitreo {

/// The nominal model: what the loop computes with. The real thing (or the simulated one) differs.
struct RigModel {
  optics::System eye;
  optics::Microscope microscope;
  optics::ImageScale top_image;                  // pixel from aerial image
  optics::SingleViewpoint projection;            // the thesis' (5.2) to (5.11), fitted to the chain's own chief rays
  std::optional<optics::ExactProjection> exact;  // in its place, where the rig asks for it
  Eigen::Vector3d eye_in_world{0, 0, -5e-3};     // m: the retina's vertex; the axes are parallel
  double side_pixel = 20.4e-6;                   // m per pixel of the side view, orthographic along +y
  Eigen::Vector2d side_centre_px{0, 0};          // where the world's origin shows in the side view
  control::CoilField field = control::CoilField::octomag();
  control::Robot robot;
  control::Medium medium;
};

/// Borrowed instruments; null where the rig has none.
struct Rig {
  std::string title;
  Camera* top_camera = nullptr;
  Camera* side_camera = nullptr;
  Interlock* coils = nullptr;  // the only way to the coils
  LensMover* lens_mover = nullptr;
  SampleHandler* sample = nullptr;
  Stage* stage = nullptr;
  RotationStage* rotation_stage = nullptr;
  FieldProbe* field_probe = nullptr;
  RigModel model;
  /// The names of the roles that are there, sorted.
  std::vector<std::string> roles() const;
};

}  // namespace vitreo
