// Plant sample: by how much the simulated plant differs from what a laboratory believes of it,
// drawn from the machine's seed with stated standard deviations.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/sim/world.h"

#include <Eigen/Core>

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

namespace vitreo::sim {

/// Standard deviations. 0: as the settings say. The coils' geometry (FieldPerturbation), the moment
/// and the converter's offsets have their own in LaboratorySettings.
struct PlantSigmas {
  double viscosity = 0;       // relative, of the medium
  double mass = 0;            // relative, of the robot's metal
  double size = 0;            // relative, of the robot's lengths; its mass follows with the cube
  double coil_delay = 0;      // relative
  double coil_bandwidth = 0;  // relative
  double latency = 0;         // relative, of cameras and pose sensor
  double jitter = 0;          // s, of cameras and pose sensor: CameraSettings::jitter at least
  double background = 0;      // T, root mean square of the magnitude
  double heat_gain = 0;       // relative, of CoilBankSettings::gain_temperature_coefficient
  double pixel = 0;           // relative, of each camera's scale
  double tilt = 0;            // rad, of the microscope about x and y; of the side camera's turn
  double eye = 0;             // m, of where the eye stands, each coordinate
  double stamp = 0;           // s, by which the stamps of exposures are late, of all alike
  /// What a laboratory does not know of its own plant after it has measured what it usually does:
  /// the default of a simulated rig (docs/simulated_laboratory.md has the reason of each).
  static PlantSigmas stated();
  void check() const;  // throws std::invalid_argument naming the parameter
};

/// What was drawn: factors of the settings' values; jitter and background come on top.
struct PlantSample {
  double viscosity = 1;
  double mass = 1;
  double size = 1;
  double coil_delay = 1;
  double coil_bandwidth = 1;
  double latency = 1;
  double jitter = 0;                    // s
  Eigen::Vector3d background{0, 0, 0};  // T
  double heat_gain = 1;
  double top_pixel = 1;
  double side_pixel = 1;
  Eigen::Vector2d tilt{0, 0};    // rad
  double side_turn = 0;          // rad
  Eigen::Vector3d eye{0, 0, 0};  // m
  double stamp = 0;              // s
  /// A name and value of each, for a record.
  std::vector<std::pair<std::string, double>> named() const;
};

/// Each from a stream of its own, so that a change of one sigma leaves the others as they were.
/// Factors stay within three standard deviations and above 0.
PlantSample sample_plant(const PlantSigmas& sigmas, std::uint64_t seed);

/// The settings' medium, robot, coils and background with the sample in them.
void apply(const PlantSample& sample, WorldSettings& world);

/// What of real coils is in no model of a loop: cores that saturate and remember, a field that
/// falls with heat (facts/magnetics 1.1; docs/simulated_laboratory.md).
void add_stated_truth(CoilBankSettings& coils);

/// s: of an instrument whose latency should be `latency`; at most 0.39 s.
double sampled_latency(const PlantSample& sample, double latency);

}  // namespace vitreo::sim
