// Driver of the Measurement Computing USB-3103: eight analog outputs of +-10 V that set the
// currents of eight coil amplifiers; eight latched writes and one sync make all step together. The
// device has no watchdog and no read-back: after a lost link it holds its last voltages
// (docs/instruments.md).
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/hid_link.h"
#include "devices/roles/coil_amplifier.h"
#include "devices/time/clock.h"

#include <memory>
#include <optional>
#include <string>

namespace vitreo::usb3103 {

struct Settings {
  std::string name = "coils";     ///< in errors
  double amperes_per_volt = 2.0;  ///< gain of the amplifiers behind it
  double current_limit = 12.0;    ///< A, per channel
  double reply_timeout = 0.1;     ///< s
  /// The digital line that enables the amplifiers when it is high, 0 to 7; none: they are always
  /// on. Since the device has no watchdog, this line is what an emergency stop or a relay can cut.
  std::optional<int> enable_line{};
  /// The line is a heartbeat's (CoilAmplifier::enable_line()): set-points leave it as it is.
  bool heartbeat = false;
  void check() const;  ///< throws std::invalid_argument naming the setting
};

/// Opens and configures the device: +-10 V on all channels, calibration read and validated, every
/// output at zero, the amplifiers disabled until currents are set. Throws DeviceError. Destruction
/// leaves the outputs at zero and the amplifiers disabled.
std::unique_ptr<CoilAmplifier> open(std::unique_ptr<HidLink> link, const Settings& settings,
                                    Clock& clock);

}  // namespace vitreo::usb3103
