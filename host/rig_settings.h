// From a rig file's tables to settings: each section is read in one place, with its bounds.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/sim/laboratory.h"
#include "devices/usb3103/driver.h"
#include "host/config.h"
#include "host/interlock.h"
#include "host/rig.h"

namespace vitreo {

struct RigSettings {
  std::string title;
  RigModel model;                  // but for the projection, which is fitted
  double projection_reach = 7e-3;  // m of aerial image for which the projection is fitted
  sim::LaboratorySettings laboratory;
  bool exact_projection = false;  // localise by the exact projection instead
  usb3103::Settings coils;
  double link_latency = 0;  // s, of each report to the coils' set-point device
  InterlockLimits limits;
  bool top_camera = false, side_camera = false, has_coils = false, lens_mover = false, sample = false;
};

/// Throws ConfigError with file and line.
RigSettings read_rig_settings(ConfigReader& reader);

}  // namespace vitreo
