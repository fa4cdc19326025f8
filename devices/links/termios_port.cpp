// Serial ports by the kernel's own interface: for those that have no entry in sysfs. Everything
// goes through termios2, for the baud rates that termios has no name for (the MPC-200 talks at
// 128000).
// SPDX-License-Identifier: Apache-2.0
#include "devices/links/node_lock.h"
#include "devices/links/serial_link.h"
#include "devices/time/error.h"

#include <asm/termbits.h>
#include <cerrno>
#include <fcntl.h>
#include <sys/file.h>
#include <sys/ioctl.h>

namespace vitreo {
namespace {

[[noreturn]] void fail(DeviceErrorKind kind, const std::string& path, const std::string& what) {
  throw DeviceError(kind, "serial:" + path, what);
}

/// Mark is the sticky bit with odd parity, space with even (termios(3), CMSPAR).
tcflag_t character_flags(const SerialSettings& settings) {
  constexpr tcflag_t kSizes[] = {CS5, CS6, CS7, CS8};
  tcflag_t flags = kSizes[settings.data_bits - 5];
  if (settings.stop_bits == 2) flags |= CSTOPB;
  if (settings.parity != Parity::none) flags |= PARENB;
  if (settings.parity == Parity::odd || settings.parity == Parity::mark) flags |= PARODD;
  if (settings.parity == Parity::mark || settings.parity == Parity::space) flags |= CMSPAR;
  return flags;
}

/// Raw bytes: no echo, no translation of line ends, no signals. CLOCAL: no modem lines are
/// waited for; HUPCL: DTR falls when the port is closed.
void configure(int handle, const std::string& path, const SerialSettings& settings) {
  termios2 wanted{};
  if (::ioctl(handle, TCGETS2, &wanted) != 0)
    fail(DeviceErrorKind::not_found, path, "is no serial port");
  wanted.c_iflag = settings.xon_xoff ? IXON | IXOFF : 0;
  wanted.c_oflag = 0;
  wanted.c_lflag = 0;
  wanted.c_cflag = character_flags(settings) | CREAD | CLOCAL | HUPCL | BOTHER |
                   (settings.rts_cts ? CRTSCTS : 0U);
  wanted.c_ispeed = wanted.c_ospeed = static_cast<speed_t>(settings.baud_rate);
  wanted.c_cc[VMIN] = 1;
  wanted.c_cc[VTIME] = 0;
  if (::ioctl(handle, TCSETS2, &wanted) != 0)
    fail(DeviceErrorKind::refused, path, "does not take the settings: " + system_error());
  // TCSETS2 succeeds when any of the settings could be made (tcsetattr(3)): read back.
  termios2 taken{};
  if (::ioctl(handle, TCGETS2, &taken) != 0 || taken.c_ospeed != wanted.c_ospeed ||
      taken.c_lflag != 0)
    fail(DeviceErrorKind::refused, path,
         "does not take " + std::to_string(settings.baud_rate) + " baud");
}

}  // namespace

std::unique_ptr<OpenFile> open_with_termios(const std::string& path,
                                            const SerialSettings& settings) {
  // O_NOCTTY: the port must not become this session's controlling terminal. O_NONBLOCK: opening
  // must not wait for a carrier.
  const int handle = ::open(path.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
  if (handle < 0 && errno == EBUSY) throw OwnedError("serial:" + path);  // TIOCEXCL
  if (handle < 0) fail(kind_of_refusal(errno), path, system_error());
  auto file = own_descriptor(handle);
  // Advisory, as in serial_port.cpp: the kernel itself lets any number of programs open a terminal.
  if (!take_for_us(handle)) throw OwnedError("serial:" + path);
  configure(handle, path, settings);
  const int lines = TIOCM_DTR | TIOCM_RTS;
  ::ioctl(handle, TIOCMBIS, &lines);   // pseudo-terminals have no such lines, and need none
  ::ioctl(handle, TCFLSH, TCIOFLUSH);  // what came before the opening answers no question of ours
  return file;
}

}  // namespace vitreo
