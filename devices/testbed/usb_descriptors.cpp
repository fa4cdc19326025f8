// SPDX-License-Identifier: Apache-2.0
#include "devices/testbed/usb_descriptors.h"

#include <algorithm>
#include <cstdio>

namespace vitreo {
namespace {

using Bytes = std::vector<std::uint8_t>;
// Indices of the string descriptors.
constexpr std::uint8_t kManufacturer = 1;
constexpr std::uint8_t kProduct = 2;
constexpr std::uint8_t kSerial = 3;

std::string format(const char* pattern, int a, int b = 0, int c = 0) {
  char text[64];
  std::snprintf(text, sizeof text, pattern, a, b, c);
  return text;
}
std::string in_hex(const Bytes& bytes) {
  std::string text;
  for (const std::uint8_t byte : bytes) text += format("%02X", byte);
  return text;
}
std::uint8_t low(int value) { return static_cast<std::uint8_t>(value & 0xFF); }
std::uint8_t high(int value) { return static_cast<std::uint8_t>(value >> 8 & 0xFF); }

// clang-format off
/// USB 2.0, table 9-8; little-endian.
Bytes device_descriptor(const UsbIdentity& d) {
  return {18, 1,         // length, type
          0x00, 0x02,    // USB 2.0
          0, 0, 0,       // the class is the interface's
          8,             // bytes of a packet on endpoint 0
          low(d.vendor), high(d.vendor), low(d.product), high(d.product),
          low(d.release), high(d.release),
          kManufacturer, kProduct, kSerial,
          1};            // configuration
}
/// One configuration, one interface, no endpoint but 0: USB 2.0, tables 9-10 and 9-12. With bulk
/// endpoints of 64 bytes (table 9-13) it is USBTMC's with USB488 (USBTMC 1.0, table 43).
Bytes configuration_descriptor(std::uint8_t interface_class, bool bulk) {
  Bytes all{9, 2, 18, 0,   // length, type, length of all
            1, 1, 0,       // interfaces, number, no name
            0x80, 50,      // powered by the bus, 100 mA
            9, 4, 0, 0, 0, interface_class, 0, 0, 0};
  if (!bulk) return all;
  constexpr std::size_t kLength = 2, kEndpoints = 13, kClass = 14;
  const Bytes endpoints{7, 5, 0x01, 2, 64, 0, 0, 7, 5, 0x82, 2, 64, 0, 0};
  all.insert(all.end(), endpoints.begin(), endpoints.end());
  all[kLength] = 32;
  all[kEndpoints] = 2;
  all[kClass] = 0xFE;
  all[kClass + 1] = 3;
  all[kClass + 2] = 1;
  return all;
}
// clang-format on
/// USB 2.0, table 9-16: UTF-16, little-endian.
/// ASCII only, so the high byte of each letter is zero.
Bytes string_descriptor(const std::string& text) {
  Bytes bytes{low(static_cast<int>(2 + 2 * text.size())), 3};
  for (const char letter : text) {
    bytes.push_back(static_cast<std::uint8_t>(letter));
    bytes.push_back(0);
  }
  return bytes;
}

}  // namespace

// Address 1 on the bus is the root hub's, so the first device has 2. The paths are those of a real
// machine's first USB controller.
UsbPaths::UsbPaths(int number)
    : device(number + 1),
      devpath(format("/devices/pci0000:00/0000:00:14.0/usb1/1-%d", number)),
      name(format("1-%d", number)),
      node(format("/dev/bus/usb/001/%03d", number + 1)) {}

// As the kernel names HID devices: bus 0003 is USB; the last four digits count instances.
HidPaths::HidPaths(const UsbPaths& usb, const UsbIdentity& identity)
    : interface_devpath(usb.devpath + "/" + usb.name + ":1.0"),
      hid_devpath(interface_devpath + "/" +
                  format("0003:%04X:%04X", identity.vendor, identity.product) +
                  format(".%04X", usb.device)),
      raw_devpath(hid_devpath + "/hidraw/hidraw" + std::to_string(usb.device)),
      node("/dev/hidraw" + std::to_string(usb.device)) {}

/// umockdev's format: P the path, N the node, E properties of udev, A attributes of sysfs, H binary
/// attributes in hexadecimal. libusb reads busnum, devnum, speed, bConfigurationValue and the
/// descriptors.
std::string describe_usb(const UsbPaths& paths, const UsbIdentity& d, std::uint8_t interface_class,
                         bool bulk) {
  Bytes descriptors = device_descriptor(d);
  const Bytes configuration = configuration_descriptor(interface_class, bulk);
  descriptors.insert(descriptors.end(), configuration.begin(), configuration.end());
  const std::string device = std::to_string(paths.device);
  return "P: " + paths.devpath + "\nN: " + paths.node.substr(5) +
         "\nE: SUBSYSTEM=usb\nE: DEVTYPE=usb_device\nE: DEVNAME=" + paths.node +
         "\nE: BUSNUM=001\nE: DEVNUM=" + format("%03d", paths.device) +
         "\nA: busnum=1\nA: devnum=" + device +
         "\nA: speed=12\nA: bConfigurationValue=1\nA: idVendor=" + format("%04x", d.vendor) +
         "\nA: idProduct=" + format("%04x", d.product) +
         "\nA: bcdDevice=" + format("%04x", d.release) + "\nA: manufacturer=" + d.manufacturer +
         "\nA: product=" + d.name + "\nA: serial=" + d.serial +
         "\nH: descriptors=" + in_hex(descriptors) + "\n\n";
}

/// Three devices, each the parent of the next: USB interface, HID device, hidraw node. hidapi reads
/// HID_ID, HID_NAME and HID_UNIQ of the middle one. MINOR need not be right: nothing opens by it.
std::string describe_hid(const UsbPaths&, const HidPaths& hid, const UsbIdentity& d,
                         const Bytes& report_descriptor) {
  return "P: " + hid.interface_devpath +
         "\nE: SUBSYSTEM=usb\nE: DEVTYPE=usb_interface\nA: bInterfaceNumber=00\n\nP: " +
         hid.hid_devpath +
         "\nE: SUBSYSTEM=hid\nE: HID_ID=" + format("0003:%08X:%08X", d.vendor, d.product) +
         "\nE: HID_NAME=" + d.manufacturer + " " + d.name + "\nE: HID_UNIQ=" + d.serial +
         "\nH: report_descriptor=" + in_hex(report_descriptor) + "\n\nP: " + hid.raw_devpath +
         "\nN: " + hid.node.substr(5) + "\nE: SUBSYSTEM=hidraw\nE: DEVNAME=" + hid.node +
         "\nE: MAJOR=241\nE: MINOR=0\n\n";
}

InputPaths::InputPaths(int number)
    : input_devpath("/devices/virtual/input/input" + std::to_string(number)),
      event_devpath(input_devpath + "/event" + std::to_string(number)),
      node("/dev/input/event" + std::to_string(number)) {}

namespace {

/// Words of 64 bits in hexadecimal, the highest first.
std::string capability(const std::vector<int>& bits) {
  std::vector<unsigned long> words(1);
  for (const int bit : bits) {
    const auto word = static_cast<std::size_t>(bit / 64);
    words.resize(std::max(words.size(), word + 1));
    words[word] |= 1UL << bit % 64;
  }
  std::string text;
  for (auto word = words.rbegin(); word != words.rend(); ++word) {
    char digits[20];
    std::snprintf(digits, sizeof digits, "%lx", *word);
    text += (text.empty() ? "" : " ") + std::string(digits);
  }
  return text;
}

}  // namespace

std::string describe_input(const InputPaths& paths, const InputNode& node) {
  std::vector<int> axes;
  for (const InputNode::Axis& axis : node.axes) axes.push_back(axis.code);
  return "P: " + paths.input_devpath + "\nE: SUBSYSTEM=input\nA: name=" + node.name +
         "\nA: uniq=" + node.serial + "\nA: id/vendor=" + format("%04x", node.vendor) +
         "\nA: id/product=" + format("%04x", node.product) +
         "\nA: capabilities/abs=" + capability(axes) +
         "\nA: capabilities/key=" + capability(node.keys) + "\n\nP: " + paths.event_devpath +
         "\nN: " + paths.node.substr(5) + "\nL: device=../../" +
         paths.input_devpath.substr(paths.input_devpath.rfind('/') + 1) +
         "\nE: SUBSYSTEM=input\nE: DEVNAME=" + paths.node + "\nE: MAJOR=13\nE: MINOR=64\n\n";
}

// clang-format off
/// Items of HID 1.11, section 6.2.2.
Bytes report_descriptor(int usage_page, int usage) {
  return {0x06, low(usage_page), high(usage_page),  // usage page
          0x0A, low(usage), high(usage),            // usage
          0xA1, 0x01,                               // application collection
          0x85, 0x01,                               // report 1
          0x15, 0x00, 0x26, 0xFF, 0x00,             // values 0 to 255
          0x75, 0x08, 0x95, 0x3F,                   // of 8 bits, 63 of them
          0x09, 0x01, 0x81, 0x02,                   // input
          0x09, 0x01, 0x91, 0x02,                   // output
          0xC0};                                    // end of the collection
}
// clang-format on

// Other standard requests of the device are accepted and have no effect.
std::optional<Bytes> standard_answer(const UsbIdentity& identity, const UsbSetup& setup,
                                     bool bulk) {
  // USB 2.0, tables 9-4 and 9-5.
  constexpr std::uint8_t kGetDescriptor = 6;
  constexpr std::uint8_t kDevice = 1;
  constexpr std::uint8_t kConfiguration = 2;
  constexpr std::uint8_t kString = 3;
  if (setup.type != 0x80) return std::nullopt;  // device to host, standard, of the device
  if (setup.request != kGetDescriptor) return Bytes{};
  switch (setup.value >> 8) {
    case kDevice:
      return device_descriptor(identity);
    case kConfiguration:
      return configuration_descriptor(0xFF, bulk);
    case kString:
      switch (setup.value & 0xFF) {
        case 0:  // the languages: English (United States)
          return Bytes{4, 3, 0x09, 0x04};
        case kManufacturer:
          return string_descriptor(identity.manufacturer);
        case kProduct:
          return string_descriptor(identity.name);
        case kSerial:
          return string_descriptor(identity.serial);
        default:
          return std::nullopt;
      }
    default:
      return std::nullopt;
  }
}

}  // namespace vitreo
