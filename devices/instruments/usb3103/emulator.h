// Emulator of the USB-3103: its end of the wire, for the simulated laboratory and the tests.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/instruments/usb3103/wire.h"
#include "devices/links/hid_link.h"

#include <array>
#include <functional>
#include <memory>

namespace vitreo::usb3103 {

using Voltages = std::array<double, kChannels>;  // V

struct EmulatorSettings {
  /// DAC calibration as the flash would hold it, per channel.
  std::array<double, kChannels> slope{1, 1, 1, 1, 1, 1, 1, 1}, offset{};
  /// At power-up; whether AOutSync does anything depends on it. A slave by default, for what a
  /// device is at power-up is not documented.
  bool master = false;
};

/// After power-up every channel is at 0 V in the range 0 to 10 V. Reports that the device would not
/// understand change nothing and get no answer. Throws std::invalid_argument for a calibration that
/// is not finite or has no inverse. `on_output` is called whenever a voltage at the terminals
/// changes, with all eight; `on_line` whenever a digital line does, with its number and level.
class Emulator : public HidPeer {
 public:
  virtual const Voltages& outputs() const = 0;
  /// What a digital line puts out; a line that is an input, as all are after power-up, puts out
  /// nothing, which is low.
  virtual bool line_is_high(int line) const = 0;
  /// Also what a pulled cable does: it lives on the bus.
  void power_cycle() override = 0;
};
std::unique_ptr<Emulator> make_emulator(const EmulatorSettings& settings,
                                        std::function<void(const Voltages&)> on_output,
                                        std::function<void(int, bool)> on_line = {});

}  // namespace vitreo::usb3103
