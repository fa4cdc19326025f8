// The USB-3103's end of the wire, for the simulated laboratory and the tests.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <functional>
#include <memory>

#include "devices/hid_link.h"

namespace vitreo::usb3103 {

constexpr int kChannels = 8;
using Voltages = std::array<double, kChannels>;  // V

struct EmulatorSettings {
  /// DAC calibration as the flash would hold it, per channel.
  std::array<double, kChannels> slope{1, 1, 1, 1, 1, 1, 1, 1}, offset{};
};

/// `on_output` is called whenever a voltage at the terminals changes, with all eight.
class Emulator : public HidPeer {
 public:
  virtual const Voltages& outputs() const = 0;
};
std::unique_ptr<Emulator> make_emulator(const EmulatorSettings& settings, std::function<void(const Voltages&)> on_output);

}  // namespace vitreo::usb3103
