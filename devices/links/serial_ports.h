// List of the system's serial ports, with the identities of their adapters. Nothing is opened, no
// byte is sent.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/usb_address.h"

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace vitreo {

struct SerialPort {
  std::string node;                // "/dev/ttyUSB0"
  std::optional<UsbIdentity> usb;  // of the adapter, or of an instrument that is its own adapter
};

/// Those with a device behind them, by name; a pseudo-terminal has none. `listing`: the kernel's
/// folder, or a test's.
std::vector<SerialPort> list_serial_ports(const std::filesystem::path& listing = "/sys/class/tty");

/// Whether a file name in /dev/serial/by-id is one that lasts. udev makes a link as ".#" with the
/// name and random digits after it and then renames it (systemd's symlink_atomic): what is listed
/// in that moment leads to the node too, and is gone at once.
inline bool is_lasting_link(std::string_view file_name) { return !file_name.starts_with('.'); }

}  // namespace vitreo
