// Measurement Computing USB-3103: eight analog outputs of +-10 V that set the currents of eight coil amplifiers.
// The device has no watchdog and no read-back: after a lost link it holds its last voltages (docs/instruments.md).
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/clock.h"
#include "devices/coil_amplifier.h"
#include "devices/hid_link.h"

#include <memory>
#include <string>

namespace vitreo::usb3103 {

struct Settings {
  std::string name = "coils";     ///< how errors call it
  double amperes_per_volt = 2.0;  ///< gain of the amplifiers behind it
  double current_limit = 12.0;    ///< A, per channel
  double reply_timeout = 0.1;     ///< s
  void check() const;             ///< throws std::invalid_argument naming the setting
};

/// Opens and configures the device: +-10 V on all channels, calibration read and validated, every output at zero.
/// Throws DeviceError. Destruction leaves the outputs at zero.
std::unique_ptr<CoilAmplifier> open(std::unique_ptr<HidLink> link, const Settings& settings, Clock& clock);

}  // namespace vitreo::usb3103
