// SPDX-License-Identifier: Apache-2.0
#include "devices/links/serial_link.h"

#include "devices/links/serial_line.h"

#include <cerrno>
#include <filesystem>
#include <stdexcept>
#include <sys/file.h>
#include <sys/ioctl.h>
#include <system_error>
#include <termios.h>

namespace vitreo {

// Followed step by step, for umockdev's realpath() writes past its end where a link of its testbed
// leads out of it.
std::string node_behind(const std::string& path) {
  constexpr int kMostLinks = 8;
  std::filesystem::path real = path;
  std::error_code none;
  for (int i = 0; i < kMostLinks && std::filesystem::is_symlink(real, none); ++i) {
    const auto target = std::filesystem::read_symlink(real, none);
    if (none) break;
    real = target.is_absolute() ? target : (real.parent_path() / target).lexically_normal();
  }
  return real.string();
}

bool has_sysfs_entry(const std::string& path) {
  std::error_code none;
  const std::filesystem::path name = std::filesystem::path(node_behind(path)).filename();
  return std::filesystem::exists(std::filesystem::path("/sys/class/tty") / name / "device", none);
}

// A lack of rights is the user's to mend, and another owner's port is there.
DeviceErrorKind kind_of_refusal(int system_error_number) {
  return system_error_number == EACCES || system_error_number == EPERM ||
                 system_error_number == EBUSY
             ? DeviceErrorKind::refused
             : DeviceErrorKind::not_found;
}

bool take_for_us(int handle) {
  if (::flock(handle, LOCK_EX | LOCK_NB) != 0) return false;
  ::ioctl(handle, TIOCEXCL);
  return true;
}

std::string to_string(const SerialSettings& settings) {
  const char parity = "NOEMS"[static_cast<int>(settings.parity)];
  return std::to_string(settings.baud_rate) + " baud, " + std::to_string(settings.data_bits) +
         parity + std::to_string(settings.stop_bits) + (settings.rts_cts ? ", RTS/CTS" : "") +
         (settings.xon_xoff ? ", XON/XOFF" : "");
}

Time character_time(const SerialSettings& settings) {
  return character_time(settings.baud_rate,
                        {settings.data_bits, settings.parity != Parity::none, settings.stop_bits});
}

const std::vector<std::string>& parity_names() {
  static const std::vector<std::string> names{"none", "odd", "even", "mark", "space"};
  return names;
}
const std::vector<std::string>& flow_names() {
  static const std::vector<std::string> names{"none", "rts_cts", "xon_xoff"};
  return names;
}
void set_flow(SerialSettings& settings, const std::string& name) {
  settings.rts_cts = name == "rts_cts";
  settings.xon_xoff = name == "xon_xoff";
}
const std::vector<std::string>& opening_lines_names() {
  static const std::vector<std::string> names{"asserted", "released", "rts_pulse", "dtr_pulse"};
  return names;
}

namespace {

/// How long a line of a pulse stays as it is.
constexpr Time kPulse = std::chrono::milliseconds(50);

void check(const SerialSettings& settings) {
  if (settings.data_bits < 5 || settings.data_bits > 8)
    throw std::invalid_argument("data_bits: must be 5 to 8");
  if (settings.stop_bits != 1 && settings.stop_bits != 2)
    throw std::invalid_argument("stop_bits: must be 1 or 2");
}

/// Pseudo-terminals have no such lines, and need none: their refusal is no error.
void set_line(int handle, int line, bool asserted) {
  ::ioctl(handle, asserted ? TIOCMBIS : TIOCMBIC, &line);
}
void flush(int handle) { ::ioctl(handle, TCFLSH, TCIOFLUSH); }

/// The port has both lines asserted by now, and was flushed.
void set_opening_lines(int handle, OpeningLines lines, Clock& clock) {
  switch (lines) {
    case OpeningLines::asserted:
      return;
    case OpeningLines::released:
      return set_line(handle, TIOCM_RTS | TIOCM_DTR, false);
    case OpeningLines::rts_pulse:
      set_line(handle, TIOCM_RTS, true);
      clock.sleep_for(kPulse);
      flush(handle);
      clock.sleep_for(kPulse);
      return set_line(handle, TIOCM_RTS, false);
    case OpeningLines::dtr_pulse:
      set_line(handle, TIOCM_DTR, false);
      clock.sleep_for(kPulse);
      set_line(handle, TIOCM_DTR, true);
      return flush(handle);
  }
}

}  // namespace

std::unique_ptr<ByteLink> open_serial(const std::string& path, const SerialSettings& settings,
                                      Clock& clock) {
  check(settings);
  return file_link(
      "serial:" + path, " at " + to_string(settings),
      [path, settings, &clock] {
        // Decided at each opening: libserialport refuses a pseudo-terminal, which has no sysfs
        // entry and no modem lines.
        auto file = has_sysfs_entry(path) ? open_with_libserialport(path, settings)
                                          : open_with_termios(path, settings);
        set_opening_lines(file->handle(), settings.opening_lines, clock);
        return file;
      },
      clock);
}

}  // namespace vitreo
