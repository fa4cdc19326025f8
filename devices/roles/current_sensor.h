// The role of a current sensor: what really flows in the coils, measured apart from the amplifiers
// that drive them, by shunts or current transducers on a data logger.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/time/clock.h"
#include "devices/time/identity.h"

#include <vector>

namespace vitreo {

struct CurrentSensorInfo {
  Identity identity;
  /// Which coil each current of a reading is of, counted from 0; no coil twice.
  std::vector<int> coils;
};

/// It has no outputs: there is nothing to make safe.
class CurrentSensor {
 public:
  virtual ~CurrentSensor() = default;
  virtual const CurrentSensorInfo& info() const = 0;
  /// A, in the order of info().coils, each measured after the call. Throws DeviceError{timeout},
  /// {refused} for a current beyond its range, {lost}, {protocol}; Stopped.
  virtual std::vector<double> measure(Time timeout) = 0;
};

}  // namespace vitreo
