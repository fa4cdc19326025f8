// Serial ports: real ones through libserialport, and those it does not know (pseudo-terminals,
// socat, ser2net) through termios.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/byte_link.h"
#include "devices/links/file_link.h"
#include "devices/time/error.h"

#include <memory>
#include <string>
#include <vector>

namespace vitreo {

/// Mark and space: the bit is always 1, always 0; not every adapter has them.
enum class Parity { none, odd, even, mark, space };

/// RTS and DTR when the port has been opened. The kernel itself asserts both while it opens one.
enum class OpeningLines {
  asserted,   ///< both on; RTS is left to hardware flow control where that is set
  released,   ///< both off: for boards that an asserted DTR restarts
  rts_pulse,  ///< RTS on, 50 ms, flush, 50 ms, RTS off; DTR on: Thorlabs' APT protocol, section 1.1
  dtr_pulse,  ///< DTR off, 50 ms, on, and flush: restarts boards that have it at their reset
};

/// Seven data bits with odd parity are what Lake Shore's gaussmeters talk.
struct SerialSettings {
  int baud_rate = 9600;
  int data_bits = 8;  ///< 5 to 8
  Parity parity = Parity::none;
  int stop_bits = 1;      ///< 1 or 2
  bool rts_cts = false;   ///< hardware flow control
  bool xon_xoff = false;  ///< software flow control: 0x11 and 0x13 never reach the driver then
  OpeningLines opening_lines = OpeningLines::asserted;
};

/// "9600 baud, 8N1, XON/XOFF".
std::string to_string(const SerialSettings& settings);
/// How long one character takes on such a line.
Time character_time(const SerialSettings& settings);
/// "none", "odd", "even", "mark", "space", in the order of the enumeration; as in a rig file.
const std::vector<std::string>& parity_names();
/// "none", "rts_cts", "xon_xoff", with one of the settings' two flags at most.
const std::vector<std::string>& flow_names();
void set_flow(SerialSettings& settings, const std::string& name);
/// "asserted", "released", "rts_pulse", "dtr_pulse".
const std::vector<std::string>& opening_lines_names();

/// `path` as in "serial:/dev/ttyUSB0". Throws std::invalid_argument for settings out of their
/// range, DeviceError{not_found}, {refused} when another program has it open or it does not take
/// the settings. A pulse of opening_lines waits on the clock, at each opening.
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

/// Neither sets the modem lines but RTS and DTR asserted; open_serial() does.
std::unique_ptr<OpenFile> open_with_libserialport(const std::string& path,
                                                  const SerialSettings& settings);
std::unique_ptr<OpenFile> open_with_termios(const std::string& path,
                                            const SerialSettings& settings);

}  // namespace vitreo
