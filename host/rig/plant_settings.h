// Settings of the simulated plant beyond the model: the table `truth` of the rig file, and measured
// fields (docs/simulated_laboratory.md).
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/field_calibration.h"
#include "devices/sim/laboratory.h"
#include "devices/sim/optics_sample.h"
#include "host/config/config.h"

#include <filesystem>
#include <string>
#include <vector>

namespace vitreo {

/// Reads all of the table but leaves files alone, and takes the laboratory as built by the model.
/// Throws ConfigError. With a `calibration` in the plant the coils' own draws are 0 unless given: a
/// measured machine needs none.
void read_plant(ConfigReader reader, sim::LaboratorySettings& laboratory, sim::OpticsSigmas& optics,
                std::string& calibration);

/// The field of a calibration file, its coils wired as the model that it replaces has them.
struct MeasuredField {
  control::FieldModel field = control::CoilField::octomag();
  std::string system_name;  ///< may be empty
  /// Of each channel against the model that it replaces, at the world's origin.
  std::vector<control::CoilComparison> coils;
  /// The channels, from 1, that drive the file's coils: not 1, 2, ... where only another wiring
  /// makes the coils lie as the model has them.
  std::vector<int> channels;
  std::vector<std::string> warnings;  ///< what the reader corrected, with the file's name
};

/// Reads a calibration file and wires its coils as `before` has them; the uniform background of
/// `before` is kept. Throws std::invalid_argument naming the file and, where it is not understood,
/// the line; also where it does not hold at the world's origin, has another number of coils than
/// `before`, or makes fields at the origin that no coil makes.
MeasuredField read_calibration(const std::filesystem::path& file,
                               const control::FieldModel& before);

}  // namespace vitreo
