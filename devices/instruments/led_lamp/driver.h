// Driver of an LED behind a current source that a spare analog output dims: the transscleral ring.
// It has no wire of its own: it composes the driver of the device with that output, by the
// amplifier's role.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/roles/coil_amplifier.h"
#include "devices/roles/lamp.h"

#include <memory>
#include <string>

namespace vitreo::led_lamp {

struct Settings {
  std::string name = "lamp";   ///< in errors
  int output = 0;              ///< of the amplifier's channels, from 0
  double full_current = 0.35;  ///< A, at level 1: what the eye and the LED bear
  void check() const;          ///< throws std::invalid_argument naming the setting
};

/// Takes the amplifier for itself, all other outputs stay at zero. Throws std::invalid_argument for
/// no amplifier, for an output that it has not, or for more current than it gives; DeviceError.
/// Opening and destruction leave it dark.
std::unique_ptr<Lamp> open(std::unique_ptr<CoilAmplifier> outputs, const Settings& settings);

}  // namespace vitreo::led_lamp
