// USB and HID devices as the kernel shows them: descriptors, and paths in sysfs and /dev, as text
// for umockdev.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/usb_link.h"
#include "devices/testbed/input_node.h"

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace vitreo {

/// Paths of the device with this number, on an emulated bus of its own.
struct UsbPaths {
  explicit UsbPaths(int number);
  std::string sysfs() const { return "/sys" + devpath; }
  int device;           ///< its address on the bus
  std::string devpath;  ///< in sysfs, without /sys
  std::string name;     ///< as the kernel calls it: bus and port
  std::string node;     ///< below /dev
};

struct HidPaths {
  HidPaths(const UsbPaths& usb, const UsbIdentity& identity);
  std::string interface_devpath;
  std::string hid_devpath;
  std::string raw_devpath;
  std::string node;
};

/// `bulk`: the interface is of the class USBTMC, with endpoints 1 OUT and 2 IN.
std::string describe_usb(const UsbPaths& paths, const UsbIdentity& identity,
                         std::uint8_t interface_class, bool bulk = false);
std::string describe_hid(const UsbPaths& paths, const HidPaths& hid, const UsbIdentity& identity,
                         const std::vector<std::uint8_t>& report_descriptor);

/// An input device without a bus, and its node.
struct InputPaths {
  explicit InputPaths(int number);
  std::string sysfs() const { return "/sys" + event_devpath; }
  std::string input_devpath;
  std::string event_devpath;
  std::string node;
};
std::string describe_input(const InputPaths& paths, const InputNode& node);

/// One collection of the usage, with an input and an output report of 63 bytes.
std::vector<std::uint8_t> report_descriptor(int usage_page, int usage);

/// The answer of every USB device to a standard request: its descriptors. Nothing when the request
/// is not a standard one.
std::optional<std::vector<std::uint8_t>> standard_answer(const UsbIdentity& identity,
                                                         const UsbSetup& setup, bool bulk = false);

}  // namespace vitreo
