// Modem control lines of a serial port as two digital outputs: RTS and DTR. No byte is sent.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/time/clock.h"

#include <memory>
#include <string>

namespace vitreo {

enum class ModemLine { rts, dtr };

class ModemLines {
 public:
  virtual ~ModemLines() = default;
  virtual const std::string& address() const = 0;  ///< as in the rig file
  /// At once. Throws DeviceError{lost}.
  virtual void set(ModemLine line, bool asserted) = 0;
};

/// `path` as in "serial:/dev/ttyUSB3". Both are deasserted; the kernel asserts both for a moment
/// while it opens the port, and deasserts them when the port is closed, however that comes. Throws
/// DeviceError{not_found}, {refused} for a port that another program has, and for one without such
/// lines, as a pseudo-terminal is.
std::unique_ptr<ModemLines> open_modem_lines(const std::string& path, Clock& clock);

}  // namespace vitreo
