// Driver of a serial adapter's control line (RTS or DTR) as an enable line, for supplies that have
// no digital output of their own. No byte is sent on the port, which has no other use.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/modem_lines.h"
#include "devices/roles/enable_line.h"

#include <memory>
#include <string>

namespace vitreo::serial_line {

struct Settings {
  std::string name = "enable_line";  ///< in errors
  ModemLine line = ModemLine::rts;
  void check() const;  ///< throws std::invalid_argument naming the setting
};

/// High is asserted: the positive voltage of RS-232, the low level of a TTL adapter. Low when it is
/// opened and when it is destroyed. Throws DeviceError.
std::unique_ptr<EnableLine> open(std::unique_ptr<ModemLines> lines, const Settings& settings);

}  // namespace vitreo::serial_line
