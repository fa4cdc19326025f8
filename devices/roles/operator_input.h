// The role of an operator's input: a joystick with six axes, buttons, pedals.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include <cstdint>
#include <string>

namespace vitreo {

struct OperatorState {
  /// Parts of full deflection, each in [-1, 1]; x right, y away from the operator, z up.
  Eigen::Vector3d translation{0, 0, 0};
  /// The same, about these axes, right-handed.
  Eigen::Vector3d rotation{0, 0, 0};
  std::uint32_t pressed = 0;  ///< a bit a button or pedal, the first in bit 0
};

class OperatorInput {
 public:
  virtual ~OperatorInput() = default;
  virtual std::string identity() const = 0;
  /// The present deflection and buttons; does not wait. Throws DeviceError{lost}. An input that
  /// comes back (devices/roles/reopening.h) is neither pressed nor deflected until it reports it.
  virtual OperatorState state() = 0;
};

/// True while all of the buttons `mask` are held on an input that works: a missing pedal is a
/// released one. Never throws, so that a caller only needs to stop when it is false.
inline bool is_held(OperatorInput* input, std::uint32_t mask) noexcept {
  try {
    return input != nullptr && mask != 0 && (input->state().pressed & mask) == mask;
  } catch (...) {
    return false;
  }
}

}  // namespace vitreo
