// What is at an address of any bus.
// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/genicam/driver.h"
#include "devices/instruments/genicam/identification.h"
#include "devices/links/address.h"
#include "devices/links/hid_link.h"
#include "devices/links/serial_ports.h"
#include "devices/links/usb_link.h"
#include "devices/time/error.h"
#include "host/rig/asking.h"
#include "host/rig/plugged_in.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <stdexcept>

namespace vitreo {
namespace {

namespace fs = std::filesystem;

/// What links to nodes lead to, as udev makes them. Links of folders are not followed: realpath()
/// would, and it corrupts the memory of a program under umockdev (0.17), where `vitreo emulate` has
/// its nodes.
fs::path node_of(fs::path path) {
  constexpr int kMostLinks = 8;
  std::error_code error;
  for (int i = 0; i < kMostLinks; ++i) {
    const fs::path target = fs::read_symlink(path, error);
    if (error) break;
    path = path.parent_path() / target;  // an absolute target stands for itself
  }
  return path.lexically_normal();
}

/// The port's entry in the system's list; nothing for what has none, such as a pseudo-terminal.
/// /dev/serial/by-id/... is a link to the node.
std::optional<SerialPort> listed_port(const std::string& path) {
  const fs::path node = node_of(path);
  for (const SerialPort& port : list_serial_ports())
    if (port.node == path || node_of(port.node) == node) return port;
  return std::nullopt;
}

/// Those whose questions are asked. Behind an adapter with a USB identity of its own there is no
/// instrument that has another one; of all other ports nothing is known.
std::vector<IdentifiedDriver> askers_for(const Address& address) {
  std::vector<IdentifiedDriver> drivers = identified_drivers();
  const auto port =
      address.bus == "serial" ? listed_port(address.place) : std::optional<SerialPort>();
  if (!port || !port->usb) return drivers;
  const std::vector<std::string> names = drivers_for(*port);
  std::erase_if(drivers, [&](const IdentifiedDriver& driver) {
    return std::find(names.begin(), names.end(), driver.name) == names.end();
  });
  return drivers;
}

AskingResult ask_the_port(const std::string& given, const Address& address, Clock& clock,
                          const std::function<void(const AskingPlan&)>& before,
                          const TellStep& tell,
                          const std::vector<std::shared_ptr<const AskedFile>>& files) {
  const std::vector<IdentifiedDriver> askers = askers_for(address);
  AskingPlan plan = plan_asking(given, askers);
  if (askers.size() != 1) plan = with_files(std::move(plan), files);  // one: its adapter's own
  const OpenLine open = [&](SerialSettings line) {
    if (line.baud_rate <= 0) line.baud_rate = SerialSettings{}.baud_rate;
    return open_byte_link(given, line, clock);
  };
  if (address.bus == "serial" && !fs::exists(address.place))
    throw DeviceError(DeviceErrorKind::not_found, given, "there is no such port");
  before(plan);
  AskingResult result = ask_port(plan, open, clock, tell);
  const std::string lasting = address.bus == "serial" ? lasting_name(address.place) : "";
  for (FoundInstrument& found : result.found)
    if (!lasting.empty() && lasting != address.place) found.lasting_address = "serial:" + lasting;
  return result;
}

/// The devices with these numbers that are plugged in, by their full addresses; a device with
/// several interfaces once.
std::vector<UsbIdentity> plugged_in_with(const std::string& bus, const UsbAddress& address) {
  std::vector<UsbIdentity> matching;
  for (const UsbIdentity& one : bus == "hid" ? list_hid_devices() : list_usb_devices()) {
    const bool known = std::any_of(matching.begin(), matching.end(), [&](const UsbIdentity& other) {
      return other.serial == one.serial;
    });
    if (one.matches(address) && !known) matching.push_back(one);
  }
  return matching;
}

/// All that the device may be, at its address with its serial number, by which a second one that is
/// plugged in later is told from it.
void add_kinds(const std::string& bus, const UsbIdentity& device, AskingResult& result) {
  const std::string address = to_string(bus, {device.vendor, device.product, device.serial});
  for (const auto& [name, identification] : identified_drivers()) {
    const UsbKind* const kind = usb_kind(identification, device.vendor, device.product);
    if (kind == nullptr || kind->roles.empty()) continue;
    const Identity who{
        device.manufacturer.empty() ? device.name : device.manufacturer + " " + device.name,
        device.serial, ""};
    result.found.push_back({name, address, 0, to_string(who), kind->roles});
  }
}

AskingResult look_on_usb(const std::string& bus, const std::string& given) {
  UsbAddress address;
  try {
    address = parse_usb_address(bus, given);
  } catch (const std::invalid_argument& problem) {
    throw ConfigError(problem.what());
  }
  const std::vector<UsbIdentity> devices = plugged_in_with(bus, address);
  if (devices.empty())
    throw DeviceError(DeviceErrorKind::not_found, given,
                      "nothing with these numbers is plugged in; vitreo devices lists what is");
  AskingResult result;
  result.plan.address = given;
  for (const UsbIdentity& device : devices) add_kinds(bus, device, result);
  if (result.found.empty())
    throw DeviceError(DeviceErrorKind::not_found, given,
                      "is plugged in, and no driver takes it by this address");
  return result;
}

/// One camera by its identity, its serial number or its IP address, or, without any, all.
AskingResult look_for_cameras(const std::string& given, const std::string& wanted) {
  AskingResult result;
  result.plan.address = given;
  std::vector<std::string> names;
  for (const genicam::Found& camera : genicam::list_cameras()) {
    names.push_back(camera.identity);
    if (!wanted.empty() && wanted != camera.identity && wanted != camera.address) continue;
    const std::string address = "genicam:" + (wanted.empty() ? camera.identity : wanted);
    result.found.push_back({"genicam", address, 0,
                            camera.vendor + " " + camera.model + ", serial " + camera.serial +
                                ", " + camera.protocol + " " + camera.address,
                            genicam::proposed_roles(camera)});
  }
  if (!result.found.empty()) return result;
  const std::string others =
      names.empty() ? "no camera answers on any interface"
                    : fmt::format("no such camera answers; these do: {}", fmt::join(names, ", "));
  throw DeviceError(DeviceErrorKind::not_found, given, others);
}

}  // namespace

std::string lasting_name(const std::string& node, const fs::path& links) {
  std::error_code error;
  const fs::path wanted = node_of(node);
  std::vector<std::string> names;
  for (const auto& link : fs::directory_iterator(links, error))
    if (is_lasting_link(link.path().filename().string()) && node_of(link.path()) == wanted)
      names.push_back(link.path().string());
  return names.empty() ? "" : *std::min_element(names.begin(), names.end());
}

std::string full_address(const std::string& given) {
  return given.starts_with("/") ? "serial:" + given : given;
}

AskingPlan plan_for_address(const std::string& given) {
  const std::string full = full_address(given);
  if (full == "genicam") return {full, {}, {}};
  try {
    const Address address = parse_address(full);
    const bool port = address.bus == "serial" || address.bus == "tcp";
    return port ? plan_asking(full, askers_for(address)) : AskingPlan{full, {}, {}};
  } catch (const std::invalid_argument& problem) {
    throw ConfigError(problem.what());
  }
}

AskingResult ask_address(const std::string& given, Clock& clock,
                         const std::function<void(const AskingPlan&)>& before, const TellStep& tell,
                         const std::vector<std::shared_ptr<const AskedFile>>& files) {
  const std::string full = full_address(given);
  if (full == "genicam") return look_for_cameras(full, "");
  Address address;
  try {
    address = parse_address(full);
  } catch (const std::invalid_argument& problem) {
    throw ConfigError(problem.what());
  }
  if (address.bus == "serial" || address.bus == "tcp")
    return ask_the_port(full, address, clock, before, tell, files);
  if (address.bus == "hid" || address.bus == "usb") return look_on_usb(address.bus, full);
  if (address.bus == "genicam") return look_for_cameras(full, address.place);
  throw ConfigError(given +
                    ": there is nothing to be asked on this bus; serial:, tcp:, hid:, usb: "
                    "and genicam: can be");
}

}  // namespace vitreo
