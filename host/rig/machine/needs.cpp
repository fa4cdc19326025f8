// SPDX-License-Identifier: Apache-2.0
#include "host/rig/machine/needs.h"

#include "host/rig/measured_chain.h"
#include "host/rig/plugged_in.h"
#include "host/rig/registry.h"
#include "host/rig/rig_settings.h"

#include <algorithm>
#include <array>
#include <sstream>

namespace vitreo::machine {
namespace {

using Json = nlohmann::json;

std::string trimmed(const std::string& text) {
  const auto begin = text.find_first_not_of(' ');
  const auto end = text.find_last_not_of(' ');
  return begin == std::string::npos ? "" : text.substr(begin, end - begin + 1);
}

/// The bytes of its gray frames, where the file says their size and rate.
double frame_bytes(const Json& settings) {
  return settings.value("width_px", 0.0) * settings.value("height_px", 0.0) *
         settings.value("frame_rate", 0.0);
}

void add(std::vector<Need>& needs, const std::string& role, const Json& settings) {
  std::istringstream addresses(settings.value("address", "emulated"));
  for (std::string one; std::getline(addresses, one, ',');) {
    const Address address = parse_address(trimmed(one));
    if (address.bus == "emulated" || is_recording(trimmed(one))) continue;
    const bool camera = address.bus == "genicam";
    needs.push_back({role, settings["driver"], address, frame_bytes(settings),
                     camera ? settings.value("packet_size", 0) : 0,
                     camera ? settings.value("socket_buffer", 0) : 0});
  }
}

const DeviceNode* node_of(const Devices& devices, const UsbDevice& usb, DeviceNode::Kind kind) {
  for (const DeviceNode& node : devices.nodes)
    if (node.kind == kind && node.usb == usb.identity.place) return &node;
  return nullptr;
}

/// HID instruments are opened by their hidraw node, others by the USB device's own.
Use use_of(const Devices& devices, const std::string& name, const UsbDevice& usb, bool hid) {
  if (!hid) return {name, "usb", usb.node, &usb};
  const DeviceNode* const node = node_of(devices, usb, DeviceNode::Kind::hid);
  return {name, "hid", node == nullptr ? "" : node->path, &usb};
}

/// What is opened of USBTMC is the USB device's own node: its kernel driver gives it up meanwhile.
Use use_of(const Devices& devices, const DeviceNode& node, const std::string& name) {
  const UsbDevice* const usb = devices.at(node.usb);
  switch (node.kind) {
    case DeviceNode::Kind::usbtmc:
      return {name, "usbtmc", usb == nullptr ? node.path : usb->node, usb};
    case DeviceNode::Kind::input:
      return {name, "evdev", node.path, usb};
    case DeviceNode::Kind::video:
      return {name, "video", node.path, usb};
    default:
      return {name, "serial", node.path, usb};
  }
}

/// Of usbtmc and evdev: a node, or the numbers of a USB device.
std::optional<Use> node_or_numbers(const Machine& machine, const Devices& devices,
                                   const Need& need) {
  if (need.address.place.starts_with("/")) {
    const std::string real = machine.real(need.address.place);
    if (real.empty()) return std::nullopt;
    const DeviceNode* const node = devices.node(real);
    return node != nullptr ? use_of(devices, *node, need.role)
                           : Use{need.role, need.address.bus, real, nullptr};
  }
  const auto fit = fitting(devices, need);
  if (fit.size() != 1) return std::nullopt;
  if (need.address.bus == "usbtmc") return Use{need.role, "usbtmc", fit[0]->node, fit[0]};
  const DeviceNode* const node = node_of(devices, *fit[0], DeviceNode::Kind::input);
  return Use{need.role, "evdev", node == nullptr ? "" : node->path, fit[0]};
}

/// What the rig's addresses name.
std::vector<Use> named(const Machine& machine, const Devices& devices, const RigNeeds& rig) {
  std::vector<Use> found;
  for (const Need& need : rig.all) {
    const std::string& bus = need.address.bus;
    if (bus == "hid" || bus == "usb") {
      const auto fit = fitting(devices, need);
      if (fit.size() == 1) found.push_back(use_of(devices, need.role, *fit[0], bus == "hid"));
    } else if (bus == "serial" || bus == "video") {
      const std::string real = machine.real(need.address.place);
      if (real.empty()) continue;
      const DeviceNode* const node = devices.node(real);
      found.push_back(node != nullptr ? use_of(devices, *node, need.role)
                                      : Use{need.role, bus, real, nullptr});
    } else if (bus == "usbtmc" || bus == "evdev") {
      if (auto use = node_or_numbers(machine, devices, need)) found.push_back(std::move(*use));
    } else if (const UsbDevice* const camera = usb_camera(devices, need)) {
      found.push_back({need.role, "genicam", camera->node, camera});
    }
  }
  return found;
}

/// What is plugged in and Vitreo can drive, or may: a serial port does not say what is behind it.
std::vector<Use> plugged_in(const Devices& devices) {
  std::vector<Use> found;
  for (const UsbDevice& usb : devices.usb) {
    const std::string driver = driver_for(usb.identity.vendor, usb.identity.product);
    if (!driver.empty())
      found.push_back(use_of(devices, usb.name(), usb, driver != "pololu_tic"));
    else if (usb.is_usb3_vision())
      found.push_back({usb.name(), "genicam", usb.node, &usb});
    else if (usb.is_usbtmc())
      found.push_back({usb.name(), "usbtmc", usb.node, &usb});
  }
  for (const DeviceNode& node : devices.nodes)
    if (node.kind == DeviceNode::Kind::serial || node.kind == DeviceNode::Kind::video ||
        node.is_game_pad()) {
      const UsbDevice* const usb = devices.at(node.usb);
      found.push_back(use_of(devices, node, usb == nullptr ? node.path : usb->name()));
    }
  return found;
}

}  // namespace

// As resolved, since drivers and addresses have defaults.
RigNeeds needs_of(const RigDescription& description) {
  ConfigReader reader(description);
  read_rig_settings(reader);
  RigNeeds needs{description.file, {}, warnings_of(description)};
  for (const auto& [role, settings] : reader.resolved().items())
    if (settings.is_object() && settings.contains("driver")) add(needs.all, role, settings);
  return needs;
}

std::vector<Use> uses(const Machine& machine, const Devices& devices,
                      const std::optional<RigNeeds>& rig) {
  return rig ? named(machine, devices, *rig) : plugged_in(devices);
}

std::vector<const UsbDevice*> fitting(const Devices& devices, const Need& need) {
  const UsbAddress address =
      parse_usb_address(need.address.bus, need.address.bus + ":" + need.address.place);
  std::vector<const UsbDevice*> found;
  for (const UsbDevice& device : devices.usb)
    if (device.identity.matches(address)) found.push_back(&device);
  return found;
}

// Aravis' identities end with the serial number: "Maker-Model-SERIAL".
const UsbDevice* usb_camera(const Devices& devices, const Need& need) {
  if (need.address.bus != "genicam") return nullptr;
  for (const UsbDevice& device : devices.usb)
    if (device.is_usb3_vision() && !device.identity.serial.empty() &&
        need.address.place.ends_with(device.identity.serial))
      return &device;
  return nullptr;
}

// The makers of the chips in adapters, as packaging/60-vitreo.rules has them: FTDI, Exar, ATEN,
// Prolific, Silicon Labs, Moxa, QinHeng (CH340), MosChip; Sutter and Zaber are their own adapters.
bool is_serial_adapter(const UsbIdentity& identity) {
  constexpr std::array kMakers{0x0403, 0x04E2, 0x0557, 0x067B, 0x10C4,
                               0x110A, 0x1342, 0x1A86, 0x2939, 0x9710};
  return std::find(kMakers.begin(), kMakers.end(), identity.vendor) != kMakers.end();
}

}  // namespace vitreo::machine
