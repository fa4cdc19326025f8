// SPDX-License-Identifier: Apache-2.0
#include "host/rig/machine/devices.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <sstream>

namespace vitreo::machine {
namespace {

const std::string kUsb = "/sys/bus/usb/devices/";

std::vector<std::string> names_in(const Machine& machine, const std::string& folder) {
  return machine.list(folder).value_or(std::vector<std::string>{});
}

/// sysfs prints the numbers of USB in hexadecimal, without a prefix.
std::uint16_t hexadecimal(const Machine& machine, const std::string& path) {
  return static_cast<std::uint16_t>(std::strtoul(machine.line(path).c_str(), nullptr, 16));
}

/// udev names its records of character devices by their numbers; sysfs has these in `dev`.
std::optional<UdevRecord> record_of(const Machine& machine, const std::string& folder) {
  const std::string numbers = machine.line(folder + "/dev");
  if (numbers.empty()) return std::nullopt;
  const auto text = machine.read("/run/udev/data/c" + numbers);
  return text ? std::optional(UdevRecord{*text}) : std::nullopt;
}

std::string interface_class(const Machine& machine, const std::string& folder) {
  return machine.line(folder + "/bInterfaceClass") + machine.line(folder + "/bInterfaceSubClass") +
         machine.line(folder + "/bInterfaceProtocol");
}

/// "1-2.3" of a path in sysfs that goes through it, and of the folders above it.
std::vector<std::string> usb_folders(const Machine& machine, const std::string& real) {
  std::vector<std::string> places;
  for (std::filesystem::path folder = real; folder.has_relative_path();
       folder = folder.parent_path())
    if (machine.has(folder.string() + "/idVendor")) places.push_back(folder.filename().string());
  return places;
}

UsbDevice read_usb(const Machine& machine, const std::string& place,
                   const std::vector<std::string>& all) {
  const std::string folder = kUsb + place;
  const auto text = [&](const char* name) { return machine.line(folder + "/" + name); };
  UsbDevice device;
  device.identity = {hexadecimal(machine, folder + "/idVendor"),
                     hexadecimal(machine, folder + "/idProduct"),
                     hexadecimal(machine, folder + "/bcdDevice"),
                     text("serial"),
                     text("manufacturer"),
                     text("product"),
                     place};
  device.speed = 1e6 * std::strtod(text("speed").c_str(), nullptr);
  device.version = text("version");
  device.node = fmt::format("/dev/bus/usb/{:03}/{:03}", std::atoi(text("busnum").c_str()),
                            std::atoi(text("devnum").c_str()));
  if (!machine.has(device.node)) device.node.clear();
  for (const std::string& name : all)
    if (name.starts_with(place + ":"))
      device.interfaces.push_back(interface_class(machine, kUsb + name));
  if (const std::string power = text("power/control"); !power.empty())
    device.may_sleep = power == "auto";
  device.hubs = usb_folders(machine, machine.real(folder));
  if (!device.hubs.empty()) device.hubs.erase(device.hubs.begin());  // itself
  device.record = record_of(machine, folder);
  return device;
}

/// Those of one class of sysfs whose names begin with `prefix`; serial ports on USB alone.
void add_nodes(std::vector<DeviceNode>& nodes, const Machine& machine, DeviceNode::Kind kind,
               const std::string& listing, const std::string& prefix) {
  for (const std::string& name : names_in(machine, listing)) {
    if (!name.starts_with(prefix)) continue;
    const std::string folder = listing + "/" + name;
    const std::string device = machine.real(folder);
    const auto usb = usb_folders(machine, device);
    // Virtual consoles are listed too, and four ttyS of a PC that has no such port.
    if (kind == DeviceNode::Kind::serial && usb.empty()) continue;
    std::string interface;
    for (std::filesystem::path at = device; at.has_relative_path() && interface.empty();
         at = at.parent_path())
      interface = interface_class(machine, at.string());
    const std::string below = kind == DeviceNode::Kind::input ? "/dev/input/" : "/dev/";
    nodes.push_back({kind, below + name, usb.empty() ? "" : usb.front(), interface,
                     record_of(machine, folder)});
  }
}

}  // namespace

bool UdevRecord::has_tag(const std::string& tag) const {
  // G: tags ever set; Q: (systemd 247 and later) those of the last event.
  return ("\n" + text).find("\nG:" + tag + "\n") != std::string::npos;
}

std::string UdevRecord::property(const std::string& name) const {
  std::istringstream lines(text);
  const std::string head = "E:" + name + "=";
  for (std::string line; std::getline(lines, line);)
    if (line.starts_with(head)) return line.substr(head.size());
  return "";
}

std::string UsbDevice::name() const {
  const std::string numbers = fmt::format("{:04x}:{:04x}", identity.vendor, identity.product);
  const std::string name = identity.manufacturer +
                           (identity.manufacturer.empty() || identity.name.empty() ? "" : " ") +
                           identity.name;
  return name.empty() ? numbers : name;
}

bool UsbDevice::has_interface(const std::string& prefix) const {
  return std::any_of(interfaces.begin(), interfaces.end(),
                     [&prefix](const std::string& one) { return one.starts_with(prefix); });
}

const UsbDevice* Devices::at(const std::string& place) const {
  const auto found = std::find_if(usb.begin(), usb.end(), [&place](const UsbDevice& device) {
    return device.identity.place == place;
  });
  return found == usb.end() ? nullptr : &*found;
}

const DeviceNode* Devices::node(const std::string& path) const {
  const auto found = std::find_if(nodes.begin(), nodes.end(),
                                  [&path](const DeviceNode& node) { return node.path == path; });
  return found == nodes.end() ? nullptr : &*found;
}

// Names with a colon are interfaces, those of devices have none. Hubs have class 09.
Devices find_devices(const Machine& machine) {
  Devices devices;
  devices.seen = machine.list("/sys/class").has_value();
  const auto all = names_in(machine, "/sys/bus/usb/devices");
  for (const std::string& name : all) {
    const bool device =
        name.find(':') == std::string::npos && machine.has(kUsb + name + "/idVendor");
    if (device && machine.line(kUsb + name + "/bDeviceClass") != "09")
      devices.usb.push_back(read_usb(machine, name, all));
  }
  add_nodes(devices.nodes, machine, DeviceNode::Kind::serial, "/sys/class/tty", "tty");
  add_nodes(devices.nodes, machine, DeviceNode::Kind::hid, "/sys/class/hidraw", "hidraw");
  add_nodes(devices.nodes, machine, DeviceNode::Kind::video, "/sys/class/video4linux", "video");
  add_nodes(devices.nodes, machine, DeviceNode::Kind::usbtmc, "/sys/class/usbmisc", "usbtmc");
  add_nodes(devices.nodes, machine, DeviceNode::Kind::input, "/sys/class/input", "event");
  return devices;
}

}  // namespace vitreo::machine
