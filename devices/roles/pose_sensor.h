// The role of a pose sensor: a position with its covariance, and the axis, without any image.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/time/clock.h"

#include <Eigen/Core>

#include <cstdint>
#include <optional>
#include <string>

namespace vitreo {

struct PoseReading {
  std::uint64_t number = 0;                 ///< counts readings, so a gap shows lost ones
  Time exposed{};                           ///< when the robot was there
  Time received{};                          ///< when the host knew
  std::optional<Eigen::Vector3d> position;  ///< m, world; nothing when there is no robot
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Identity();  ///< m^2
  std::optional<Eigen::Vector3d> axis{};  ///< the robot's, unit, world; nothing: not measured
};

class PoseSensor {
 public:
  virtual ~PoseSensor() = default;
  virtual std::string identity() const = 0;
  virtual double period() const = 0;  ///< s
  /// Waits for the newest reading that was not yet returned. Throws DeviceError{timeout} after
  /// `timeout`, Stopped.
  virtual PoseReading read(Time timeout) = 0;
};

}  // namespace vitreo
