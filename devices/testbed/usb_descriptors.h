// What the kernel shows of a USB or HID device: its descriptors and its places in sysfs and /dev,
// as text for umockdev.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/usb_link.h"

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace vitreo {

/// Where the device with this number is, on an emulated bus of its own.
struct UsbPlace {
  explicit UsbPlace(int number);
  std::string sysfs() const { return "/sys" + devpath; }
  int device;
  std::string devpath, name, node;
};

struct HidPlace {
  HidPlace(const UsbPlace& usb, const UsbIdentity& identity);
  std::string interface_devpath, hid_devpath, raw_devpath, node;
};

std::string describe_usb(const UsbPlace& place, const UsbIdentity& identity,
                         std::uint8_t interface_class);
std::string describe_hid(const UsbPlace& place, const HidPlace& hid, const UsbIdentity& identity,
                         const std::vector<std::uint8_t>& report_descriptor);

/// One collection of the usage, with an input and an output report of 63 bytes.
std::vector<std::uint8_t> report_descriptor(int usage_page, int usage);

/// What every USB device answers by itself: its descriptors. Nothing when the request is not a
/// standard one.
std::optional<std::vector<std::uint8_t>> standard_answer(const UsbIdentity& identity,
                                                         const UsbSetup& setup);

}  // namespace vitreo
