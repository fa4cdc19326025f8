// Devices of a machine that an instrument can be: USB devices and the nodes below /dev that they
// have, from sysfs and udev's records. Nothing is opened.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/usb_address.h"
#include "host/rig/machine/machine.h"

#include <optional>
#include <string>
#include <vector>

namespace vitreo::machine {

/// What udev noted about a device (/run/udev/data): "E:NAME=value", "Q:tag".
struct UdevRecord {
  std::string text;
  bool has_tag(const std::string& tag) const;
  /// "" where the property is not there.
  std::string property(const std::string& name) const;
};

struct UsbDevice {
  UsbIdentity identity;                 // place: "1-2.3", its folder in /sys/bus/usb/devices
  double speed = 0;                     // bit/s of the port's connection; 0: not told
  std::string version;                  // of USB, as the device announces it: "2.10"
  std::string node;                     // "/dev/bus/usb/001/004"; "" where it has none
  std::vector<std::string> interfaces;  // class, subclass, protocol in hexadecimal: "ef0500"
  std::optional<bool> may_sleep{};      // the kernel may suspend it when it is idle
  std::vector<std::string> hubs{};      // places of the hubs above it, the nearest first
  std::optional<UdevRecord> record{};   // nothing: udev has none
  std::string name() const;             // "FTDI FT232R USB UART", or its numbers
  bool has_interface(const std::string& prefix) const;
  bool is_usb3_vision() const { return has_interface("ef05"); }
  bool is_usbtmc() const { return has_interface("fe03"); }
};

struct DeviceNode {
  enum class Kind { serial, hid, video, usbtmc, input };
  Kind kind;
  std::string path;          // "/dev/ttyUSB0"
  std::string usb;           // place of the USB device that it belongs to; "": none
  std::string interface {};  // of that device, "020201"; "": not known
  std::optional<UdevRecord> record{};
  /// Of an input node: a game pad or joystick, and no keyboard.
  bool is_game_pad() const {
    return kind == Kind::input && record && record->property("ID_INPUT_JOYSTICK") == "1";
  }
};

struct Devices {
  bool seen = false;           // sysfs is there: what is not listed is not plugged in
  std::vector<UsbDevice> usb;  // without hubs
  std::vector<DeviceNode> nodes;
  const UsbDevice* at(const std::string& place) const;  // null: none
  const DeviceNode* node(const std::string& path) const;
};

Devices find_devices(const Machine& machine);

}  // namespace vitreo::machine
