// SPDX-License-Identifier: Apache-2.0
#include "devices/links/serial_link.h"

#include <cerrno>
#include <filesystem>
#include <sys/file.h>
#include <sys/ioctl.h>
#include <system_error>

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
  const char* const parity = settings.parity == Parity::odd    ? "O"
                             : settings.parity == Parity::even ? "E"
                                                               : "N";
  return std::to_string(settings.baud_rate) + " baud, " + std::to_string(settings.data_bits) +
         parity + "1" + (settings.rts_cts ? ", RTS/CTS" : "") +
         (settings.xon_xoff ? ", XON/XOFF" : "");
}

std::unique_ptr<ByteLink> open_serial(const std::string& path, const SerialSettings& settings,
                                      Clock& clock) {
  return file_link(
      "serial:" + path, " at " + to_string(settings),
      [path, settings] {
        // Decided at each opening: libserialport refuses a pseudo-terminal, which has no sysfs
        // entry and no modem lines.
        return has_sysfs_entry(path) ? open_with_libserialport(path, settings)
                                     : open_with_termios(path, settings);
      },
      clock);
}

}  // namespace vitreo
