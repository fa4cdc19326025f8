// The role of the BIOM's motor: it moves the condensing lens along the optical axis to focus.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/time/clock.h"

#include <string>

namespace vitreo {

class LensMover {
 public:
  virtual ~LensMover() = default;
  virtual std::string identity() const = 0;
  /// m from the nominal position of the condensing lens, away from the eye.
  virtual double position() const = 0;
  /// Moves and waits until it is there. Throws DeviceError{out_of_range} outside the travel,
  /// {refused} before home(), {timeout}; Stopped. However it ends, the motor stands.
  virtual void move_to(double position, Time timeout) = 0;
  virtual double travel_min() const = 0;
  virtual double travel_max() const = 0;
  /// Whether position() can be believed; a motor that counts its steps loses its position with its
  /// power.
  virtual bool homed() const = 0;
  /// Finds its reference by its switch, and waits for it. Throws as move_to() does.
  virtual void home(Time timeout) = 0;
  virtual void make_safe() = 0;  ///< stops where it is
};

}  // namespace vitreo
