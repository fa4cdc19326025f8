// The rig file's `truth`: what the simulated plant is, beyond what the model says.
// docs/simulated_laboratory.md has the table of these settings.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/sim/laboratory.h"
#include "host/config/config.h"

#include <filesystem>
#include <string>
#include <vector>

namespace vitreo {

/// Reads all of the table but leaves files alone, and takes the laboratory as built by the model.
/// Throws ConfigError. With a `calibration` in the plant the coils' own draws are 0 unless given: a
/// measured machine needs none.
void read_plant(ConfigReader reader, sim::LaboratorySettings& laboratory, std::string& calibration);

/// The field of a calibration file, with `background` kept. Throws std::invalid_argument naming the
/// file and, where it is not understood, the line; or where it does not hold at the world's origin,
/// or has not `coils` coils.
struct MeasuredField {
  control::FieldModel field = control::CoilField::octomag();
  std::string system_name;  // may be empty
  double difference =
      0;  // from `before` at the world's origin: of all coils' fields per ampere, relative, rms
  std::vector<int> channels;  // that drive the file's coils, from 1: not 1, 2, ... where only
                              // another wiring makes the coils lie as `before` has them
};
MeasuredField read_calibration(const std::filesystem::path& file,
                               const control::FieldModel& before);

}  // namespace vitreo
