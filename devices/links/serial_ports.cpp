// SPDX-License-Identifier: Apache-2.0
#include "devices/links/serial_ports.h"

#include <algorithm>
#include <cstdlib>
#include <fstream>

namespace vitreo {
namespace {

namespace fs = std::filesystem;

/// The first line of an attribute; empty where there is none.
std::string attribute(const fs::path& folder, const char* name) {
  std::ifstream file(folder / name);
  std::string line;
  std::getline(file, line);
  return line;
}

/// sysfs prints the numbers of USB in hexadecimal, without a prefix.
std::uint16_t number(const fs::path& folder, const char* name) {
  return static_cast<std::uint16_t>(std::strtoul(attribute(folder, name).c_str(), nullptr, 16));
}

/// The USB device on which `device` hangs: the nearest folder above it that has USB's numbers.
std::optional<UsbIdentity> usb_above(const fs::path& device) {
  std::error_code none;
  fs::path folder = fs::canonical(device, none);
  for (; !none && folder.has_relative_path(); folder = folder.parent_path()) {
    if (!fs::exists(folder / "idVendor", none)) continue;
    return UsbIdentity{number(folder, "idVendor"),        number(folder, "idProduct"),
                       number(folder, "bcdDevice"),       attribute(folder, "serial"),
                       attribute(folder, "manufacturer"), attribute(folder, "product"),
                       folder.filename().string()};
  }
  return std::nullopt;
}

}  // namespace

std::vector<SerialPort> list_serial_ports(const fs::path& listing) {
  std::vector<SerialPort> ports;
  std::error_code none;
  for (fs::directory_iterator port(listing, none), end; !none && port != end;
       port.increment(none)) {
    std::error_code absent;
    // Virtual consoles are listed too; they have no device behind them.
    if (!fs::exists(port->path() / "device/driver", absent)) continue;
    ports.push_back(
        {"/dev/" + port->path().filename().string(), usb_above(port->path() / "device")});
  }
  std::sort(ports.begin(), ports.end(),
            [](const SerialPort& a, const SerialPort& b) { return a.node < b.node; });
  return ports;
}

}  // namespace vitreo
