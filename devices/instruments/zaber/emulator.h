// Emulator of Zaber devices: their end of the wire, for the simulated laboratory and the tests.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/byte_link.h"

#include <memory>
#include <string>
#include <vector>

namespace vitreo::zaber {

struct EmulatedAxis {
  double limit_min = 0;
  double limit_max = 1'062'992;  ///< usteps (50.6 mm of an X-LSM050A)
  double max_speed = 153'600;    ///< usteps/s; at power-up
  double home_speed = 80'000;    ///< usteps/s
  int resolution = 64;           ///< usteps per step
  double start = 0;              ///< usteps, at power-up
  bool referenced = true;        ///< at power-up (parked, or an absolute encoder)
};

struct EmulatedDevice {
  int address = 1;
  int device_id = 50081;
  int serial = 12345;
  std::string version = "7.14";
  std::vector<EmulatedAxis> axes{EmulatedAxis{}};
};

/// A chain of devices on one port. Axes move at constant speed.
class Emulator : public BytePeer {
 public:
  /// usteps, where the axis really is at `now`, or was since it last set off. Indices from 0.
  virtual double position(std::size_t device, std::size_t axis, Time now) const = 0;
  virtual bool moving(std::size_t device, std::size_t axis, Time now) const = 0;
  /// The axis is blocked at a position: it stalls there on its way, and stops (FS).
  virtual void jam(std::size_t device, std::size_t axis, double at) = 0;
  /// All axes are held where they are: one that moves stops, one that sets off stalls at once (FS).
  virtual void hold(bool held, Time now) = 0;
  /// It stands where it stood, without a reference.
  void power_cycle(Time now) override = 0;
};

/// Throws std::invalid_argument for devices without axes or two of the same address.
std::unique_ptr<Emulator> make_emulator(const std::vector<EmulatedDevice>& devices = {
                                            EmulatedDevice{}});

}  // namespace vitreo::zaber
