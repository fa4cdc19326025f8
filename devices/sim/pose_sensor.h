// Simulated pose sensor: the true position, late and noisy, for judging control without optics. The
// only way by which truth may reach a loop, and only one that asks for it by name (feedback
// "pose_sensor").
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/roles/pose_sensor.h"
#include "devices/sim/faults.h"

#include <cstdint>
#include <functional>
#include <memory>

namespace vitreo::sim {

struct PoseSensorSettings {
  double frame_rate = 15;        // Hz
  double latency = 80e-3;        // s: with the coils' 50 ms the 130 ms of the loop
  double noise = 0.3 * 14.3e-6;  // m, of each coordinate, white: 0.3 px
  double axis_noise = 0.01;      // rad, of the axis in each direction across it, white
  void check() const;            // throws std::invalid_argument naming the parameter
};

/// The robot's position (m, world) at a time that lies up to 0.5 s back; nothing without a robot.
using TruePosition = std::function<std::optional<Eigen::Vector3d>(Time)>;
/// Its axis, unit, at the same time.
using TrueAxis = std::function<std::optional<Eigen::Vector3d>(Time)>;

/// `faults` outlives the sensor; null: none. Without `axis` it measures none.
std::unique_ptr<PoseSensor> make_pose_sensor(const PoseSensorSettings& settings, TruePosition truth,
                                             Clock& clock, std::uint64_t seed,
                                             const ImagingFaults* faults = nullptr,
                                             TrueAxis axis = {});

}  // namespace vitreo::sim
