// The role of the BIOM's motor: it moves the condensing lens along the optical axis to focus.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/clock.h"

#include <string>

namespace vitreo {

class LensMover {
 public:
  virtual ~LensMover() = default;
  virtual std::string identity() const = 0;
  virtual double position() const = 0;  ///< m from the nominal place of the condensing lens, away from the eye
  /// Moves and waits until it is there. Throws DeviceError{refused} outside the travel, {timeout}; Stopped.
  virtual void move_to(double position, Time timeout) = 0;
  virtual double travel_min() const = 0;
  virtual double travel_max() const = 0;
  virtual void make_safe() = 0;  ///< stops where it is
};

}  // namespace vitreo
