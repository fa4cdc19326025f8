// Addresses of USB instruments in rig files: usb:1ffb:00b3 or hid:09db:009c, with :SERIAL where
// there are several.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>

namespace vitreo {

struct UsbAddress {
  std::uint16_t vendor = 0;
  std::uint16_t product = 0;
  std::string serial;  ///< empty: any, if it is the only one
};

/// Identity of a device on the bus, from its descriptors.
struct UsbIdentity {
  std::uint16_t vendor = 0;
  std::uint16_t product = 0;
  std::uint16_t release = 0;  ///< bcdDevice, which many use for the firmware's version
  std::string serial;
  std::string manufacturer;
  std::string name;
  std::string place;  ///< where it is plugged in: bus and device, or the node
  bool matches(const UsbAddress& address) const {
    return vendor == address.vendor && product == address.product &&
           (address.serial.empty() || serial == address.serial);
  }
};

/// `scheme` is "usb" or "hid". Throws std::invalid_argument naming the address and what it should
/// look like.
UsbAddress parse_usb_address(const std::string& scheme, const std::string& address);
/// As in a rig file, in lower case.
std::string to_string(const std::string& scheme, const UsbAddress& address);

}  // namespace vitreo
