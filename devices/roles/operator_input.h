// The role of what an operator holds or stands on: a joystick with six axes, buttons, pedals.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include <cstdint>
#include <string>

namespace vitreo {

struct OperatorState {
  Eigen::Vector3d translation{
      0, 0, 0};  ///< of full deflection, each in [-1, 1]; x right, y away from the operator, z up
  Eigen::Vector3d rotation{0, 0, 0};  ///< the same, about these axes, right-handed
  std::uint32_t pressed = 0;          ///< a bit a button or pedal, the first in bit 0
};

class OperatorInput {
 public:
  virtual ~OperatorInput() = default;
  virtual std::string identity() const = 0;
  /// What the operator does now; does not wait. Throws DeviceError{lost}. One that comes back
  /// (devices/roles/reopening.h) is neither pressed nor deflected until it says so itself.
  virtual OperatorState state() = 0;
};

/// True while all of the buttons `mask` are held on an input that works: a missing pedal is a
/// released one. Never throws, so that whoever asks only needs to stop when it says no.
inline bool is_held(OperatorInput* input, std::uint32_t mask) noexcept {
  try {
    return input != nullptr && mask != 0 && (input->state().pressed & mask) == mask;
  } catch (...) {
    return false;
  }
}

}  // namespace vitreo
