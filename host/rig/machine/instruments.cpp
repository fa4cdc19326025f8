// Check of a rig's instruments: whether what each address names is there.
// SPDX-License-Identifier: Apache-2.0
#include "devices/links/serial_ports.h"
#include "host/rig/machine/checks.h"

#include <fmt/format.h>

#include <algorithm>

namespace vitreo::machine {
namespace {

Finding missing(const std::string& found) { return {"", State::fault, found, {}, true}; }

std::string address_text(const Need& need) { return need.address.bus + ":" + need.address.place; }

/// " (here are /dev/ttyUSB1 and /dev/ttyUSB2)".
std::string nodes_here(const Scene& scene, DeviceNode::Kind kind) {
  std::vector<std::string> here;
  for (const DeviceNode& node : scene.devices.nodes)
    if (node.kind == kind) here.push_back(node.path);
  return here.empty() ? " (no such port is)"
                      : fmt::format(" (here {} {})", here.size() == 1 ? "is" : "are", listed(here));
}

Finding check_usb(const Scene& scene, const Need& need) {
  const auto fit = fitting(scene.devices, need);
  const std::string name = need.role + ": " + address_text(need);
  if (fit.empty()) return missing(name + " is not plugged in");
  if (fit.size() > 1) {
    std::vector<std::string> serials;
    for (const UsbDevice* const device : fit) serials.push_back(device->identity.serial);
    return said(State::fault, fmt::format("{} fits {} devices, say which in the rig file: :{}",
                                          name, fit.size(), fmt::join(serials, " or :")));
  }
  const bool node = std::any_of(
      scene.devices.nodes.begin(), scene.devices.nodes.end(), [&](const DeviceNode& one) {
        return one.kind == DeviceNode::Kind::hid && one.usb == fit[0]->identity.place;
      });
  if (need.address.bus == "hid" && !node)
    return said(State::fault, name + " is plugged in, but has no hidraw node",
                {"sudo modprobe usbhid hid-generic"});
  return said(State::good, need.role);
}

/// The lasting name of a serial port, /dev/serial/by-id/...; "" where udev has given it none.
std::string lasting_name(const Machine& machine, const std::string& node) {
  const std::string folder = "/dev/serial/by-id";
  for (const std::string& name : machine.list(folder).value_or(std::vector<std::string>{}))
    if (is_lasting_link(name) && machine.real(folder + "/" + name) == node)
      return folder + "/" + name;
  return "";
}

/// A port's number is that of its plugging: with several adapters they can change places.
Finding check_node(const Scene& scene, const Need& need, DeviceNode::Kind kind) {
  const std::string& place = need.address.place;
  if (!scene.machine.has(place))
    return missing(need.role + ": " + place + " is not there" + nodes_here(scene, kind));
  const auto& nodes = scene.devices.nodes;
  const auto ports = std::count_if(nodes.begin(), nodes.end(), [](const DeviceNode& node) {
    return node.kind == DeviceNode::Kind::serial;
  });
  const bool numbered = place.starts_with("/dev/ttyUSB") || place.starts_with("/dev/ttyACM");
  const std::string lasting = numbered && ports > 1 ? lasting_name(scene.machine, place) : "";
  if (!lasting.empty())
    return said(State::warning, need.role + ": " + place +
                                    " may be another port after the next plugging; in the rig "
                                    "file: address = \"serial:" +
                                    lasting + "\"");
  return said(State::good, need.role);
}

Finding check_camera(const Scene& scene, const Need& need) {
  if (usb_camera(scene.devices, need) != nullptr) return said(State::good, need.role);
  return said(State::unknown, need.role);
}

// libraw1394's node of the bus itself; the cameras on it are not asked.
Finding check_firewire(const Scene& scene, const Need& need) {
  const auto dev = scene.machine.list("/dev").value_or(std::vector<std::string>{});
  const bool any = std::any_of(dev.begin(), dev.end(),
                               [](const std::string& name) { return name.starts_with("fw"); });
  return any ? said(State::unknown, need.role)
             : missing(need.role + ": " + address_text(need) + ": no FireWire device is there");
}

Finding check_need(const Scene& scene, const Need& need) {
  const std::string& bus = need.address.bus;
  if (bus == "hid" || bus == "usb") return check_usb(scene, need);
  if (bus == "serial") return check_node(scene, need, DeviceNode::Kind::serial);
  if (bus == "video") return check_node(scene, need, DeviceNode::Kind::video);
  if (bus == "usbtmc" || bus == "evdev") {
    const bool by_node = need.address.place.starts_with("/");
    return by_node ? check_node(scene, need,
                                bus == "evdev" ? DeviceNode::Kind::input : DeviceNode::Kind::usbtmc)
                   : check_usb(scene, need);
  }
  if (bus == "genicam") return check_camera(scene, need);
  if (bus == "iidc") return check_firewire(scene, need);
  return said(State::unknown, need.role);  // on the network, and nothing is sent
}

void add_once(std::vector<std::string>& names, const std::string& name) {
  if (std::find(names.begin(), names.end(), name) == names.end()) names.push_back(name);
}

}  // namespace

Findings check_instruments(const Scene& scene) {
  Findings found;
  std::vector<std::string> there, unasked;
  for (const Need& need : scene.wanted.rig->all) {
    const Finding finding = check_need(scene, need);
    if (finding.state == State::good)
      add_once(there, finding.found);
    else if (finding.state == State::unknown)
      add_once(unasked, finding.found);
    else
      found.push_back(finding);
  }
  if (!unasked.empty())
    found.push_back(
        said(State::unknown,
             "not asked, since nothing is sent: " + listed(unasked) + "; this opens the whole rig",
             {scene.wanted.program + " devices --rig " + shell_word(scene.wanted.rig->rig)}));
  if (!there.empty()) found.push_back(said(State::good, "here: " + listed(there)));
  return found;
}

}  // namespace vitreo::machine
