// SPDX-License-Identifier: Apache-2.0
#include "devices/serial_link.h"

#include <filesystem>
#include <system_error>

namespace vitreo {

bool has_sysfs_entry(const std::string& path) {
  std::error_code none;
  const auto real = std::filesystem::canonical(path, none);  // /dev/serial/by-id/... are links
  if (none) return false;
  return std::filesystem::exists(std::filesystem::path("/sys/class/tty") / real.filename() / "device", none);
}

std::unique_ptr<ByteLink> open_serial(const std::string& path, const SerialSettings& settings, Clock& clock) {
  return file_link(
      "serial:" + path,
      [path, settings] {
        return has_sysfs_entry(path) ? open_with_libserialport(path, settings) : open_with_termios(path, settings);
      },
      clock);
}

}  // namespace vitreo
