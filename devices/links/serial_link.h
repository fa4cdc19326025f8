// Serial ports: real ones through libserialport, and those it does not know (pseudo-terminals,
// socat, ser2net) through termios.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/byte_link.h"
#include "devices/links/file_link.h"
#include "devices/time/error.h"

#include <memory>
#include <string>

namespace vitreo {

enum class Parity { none, odd, even };

/// One stop bit. Seven data bits with odd parity are what Lake Shore's gaussmeters talk.
struct SerialSettings {
  int baud_rate = 9600;
  int data_bits = 8;  ///< 7 or 8
  Parity parity = Parity::none;
  bool rts_cts = false;   ///< hardware flow control
  bool xon_xoff = false;  ///< software flow control: 0x11 and 0x13 never reach the driver then
};

/// "9600 baud, 8N1, XON/XOFF".
std::string to_string(const SerialSettings& settings);

/// `path` as in "serial:/dev/ttyUSB0". DTR and RTS are asserted. Throws DeviceError{not_found},
/// {refused} when another program has it open or it does not take the settings.
std::unique_ptr<ByteLink> open_serial(const std::string& path, const SerialSettings& settings,
                                      Clock& clock);

/// Locks the open port, and closes it to programs that do not lock (TIOCEXCL; root still opens it).
/// False where another program has it.
bool take_for_us(int handle);

/// The node that a name leads to: /dev/serial/by-id/... are links, which libserialport does not
/// follow.
std::string node_behind(const std::string& path);

/// Whether the kernel lists a device behind the terminal: libserialport takes no other.
bool has_sysfs_entry(const std::string& path);

/// Kind of the error of a port that the system does not open, by its errno: {refused} for a lack of
/// rights and for another owner, {not_found} for all else.
DeviceErrorKind kind_of_refusal(int system_error_number);

std::unique_ptr<OpenFile> open_with_libserialport(const std::string& path,
                                                  const SerialSettings& settings);
std::unique_ptr<OpenFile> open_with_termios(const std::string& path,
                                            const SerialSettings& settings);

}  // namespace vitreo
