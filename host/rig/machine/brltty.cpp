// Check of brltty, which drives Braille displays and takes serial adapters for them.
// SPDX-License-Identifier: Apache-2.0
#include "host/rig/machine/checks.h"
#include "host/rig/machine/config_files.h"
#include "host/rig/machine/udev_rule.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <map>
#include <set>

namespace vitreo::machine {
namespace {

bool has_unit(const Machine& machine, const std::string& unit) {
  return machine.has("/usr/lib/systemd/system/" + unit) ||
         machine.has("/lib/systemd/system/" + unit);
}
/// One rule of brltty's against a USB device; `attribute(name, above)` gives the device's own, or
/// those of the hubs above it, too. Terms that say nothing about the device count as true.
bool takes(const std::vector<RuleTerm>& rule, const UsbDevice& device, const Machine& machine) {
  bool named = false;
  for (const RuleTerm& term : rule) {
    if (term.sign != "==" && term.sign != "!=") continue;
    std::vector<std::string> values;
    if (term.key == "ENV" && term.of == "PRODUCT") {
      values = {fmt::format("{:x}/{:x}/{:x}", device.identity.vendor, device.identity.product,
                            device.identity.release)};
      named = true;
    } else if (term.key == "ATTR" || term.key == "ATTRS") {
      const std::map<std::string, std::string> own{
          {"manufacturer", device.identity.manufacturer},
          {"product", device.identity.name},
          {"serial", device.identity.serial},
          {"idVendor", fmt::format("{:04x}", device.identity.vendor)},
          {"idProduct", fmt::format("{:04x}", device.identity.product)}};
      if (const auto value = own.find(term.of); value != own.end()) values = {value->second};
      for (const std::string& hub : device.hubs)
        if (term.key == "ATTRS")
          values.push_back(machine.line("/sys/bus/usb/devices/" + hub + "/" + term.of));
    } else {
      continue;
    }
    const bool fit = std::any_of(values.begin(), values.end(), [&term](const std::string& value) {
      return fits(term.value, value);
    });
    if (fit != (term.sign == "==")) return false;
  }
  return named;
}

/// The chips in most adapters, as they come from their makers.
std::vector<UsbDevice> usual_adapters() {
  const auto adapter = [](std::uint16_t vendor, std::uint16_t product, const char* maker,
                          const char* name) {
    UsbDevice device;
    device.identity = {vendor, product, 0x0100, "", maker, name, ""};
    return device;
  };
  return {adapter(0x0403, 0x6001, "FTDI", "FT232R USB UART"),
          adapter(0x10C4, 0xEA60, "Silicon Labs", "CP2102 USB to UART Bridge Controller"),
          adapter(0x1A86, 0x7523, "", "USB Serial"),
          adapter(0x067B, 0x2303, "Prolific Technology Inc.", "USB-Serial Controller")};
}

struct Claim {
  std::string device;
  std::string file;
};

/// Which of the devices a rule of brltty's names, and in which file.
std::vector<Claim> claims(const Scene& scene, const std::vector<UsbDevice>& devices) {
  std::vector<Claim> found;
  for (const ConfigFile& file : config_files(scene.machine, "udev/rules.d")) {
    if (file.masked || file.path.find("brltty") == std::string::npos) continue;
    const auto rules = read_rules(file.text);
    for (const UsbDevice& device : devices)
      if (std::any_of(rules.begin(), rules.end(), [&](const std::vector<RuleTerm>& rule) {
            return takes(rule, device, scene.machine);
          }))
        found.push_back({device.name(), file.path});
  }
  return found;
}

/// Whether any adapter concerns us: without a rig, or while one of its ports is not there, which
/// may be behind it.
bool any_adapter_concerns(const Scene& scene) {
  const auto ports = scene.needs({"serial"});
  return !scene.rig() || std::any_of(ports.begin(), ports.end(), [&scene](const Need& need) {
    return !scene.machine.has(need.address.place);
  });
}

/// Whether it is one of the instruments.
bool is_used(const Scene& scene, const UsbDevice& device) {
  return std::any_of(scene.uses.begin(), scene.uses.end(), [&device](const Use& use) {
    return use.usb != nullptr && use.usb->identity.place == device.identity.place;
  });
}

/// Adapters that are plugged in, and those of them that have no serial port.
struct Adapters {
  std::vector<UsbDevice> all, without_port;
};
Adapters adapters_of(const Scene& scene) {
  Adapters found;
  const bool any = any_adapter_concerns(scene);
  for (const UsbDevice& device : scene.devices.usb) {
    if (!is_serial_adapter(device.identity)) continue;
    if (!any && !is_used(scene, device)) continue;
    found.all.push_back(device);
    const auto& nodes = scene.devices.nodes;
    if (std::none_of(nodes.begin(), nodes.end(), [&device](const DeviceNode& node) {
          return node.kind == DeviceNode::Kind::serial && node.usb == device.identity.place;
        }))
      found.without_port.push_back(device);
  }
  return found;
}

std::vector<std::string> stop_brltty(const Scene& scene, const std::vector<Claim>& claims) {
  std::set<std::string> files;
  for (const Claim& claim : claims) files.insert(std::filesystem::path(claim.file).filename());
  std::vector<std::string> commands;
  for (const std::string& file : files)
    commands.push_back("sudo ln -sf /dev/null /etc/udev/rules.d/" + shell_word(file));
  if (!files.empty()) commands.emplace_back("sudo udevadm control --reload");
  std::string units;
  for (const char* const unit : {"brltty.service", "brltty-udev.service"})
    if (has_unit(scene.machine, unit) && !is_masked(scene.machine, unit))
      units += std::string(" ") + unit;
  if (!units.empty()) commands.push_back("sudo systemctl mask --now" + units);
  return commands;
}

std::string names_of(const std::vector<Claim>& claims) {
  std::vector<std::string> names;
  for (const Claim& claim : claims) names.push_back(claim.device);
  return listed(names);
}

}  // namespace

// Ubuntu's brltty brings rules that give it generic adapters; Debian 12's brings none, but its
// daemon looks for Braille displays behind adapters by itself.
Findings check_brltty(const Scene& scene) {
  const Adapters adapters = adapters_of(scene);
  const bool running = runs(scene.machine, "brltty");
  const bool to_come = adapters.all.empty() && any_adapter_concerns(scene);
  const auto claimed = claims(scene, to_come ? usual_adapters() : adapters.all);
  if (!adapters.without_port.empty()) {
    std::vector<std::string> names;
    for (const UsbDevice& device : adapters.without_port)
      names.push_back(device.name() + " (usb " + device.identity.place + ")");
    const bool blamed = running || !claimed.empty();
    return {
        said(State::fault,
             listed(names) + (blamed ? ": no serial port, brltty has taken it; pull the cable "
                                       "and put it back afterwards"
                                     : ": no serial port, though it is an adapter; the "
                                       "kernel's messages say why"),
             blamed ? stop_brltty(scene, claimed)
                    : std::vector<std::string>{"sudo dmesg | grep -i -e usb -e tty | tail -n 20"})};
  }
  if (!claimed.empty())
    return {
        said(to_come ? State::warning : State::fault,
             claimed.front().file + " gives brltty " + (to_come ? "any " : "") + names_of(claimed),
             stop_brltty(scene, claimed))};
  if (running)
    return {said(State::warning, "runs, and tries USB serial adapters for Braille displays",
                 stop_brltty(scene, {}))};
  if (scene.machine.has("/usr/bin/brltty") || scene.machine.has("/bin/brltty"))
    return {said(State::good, "does not run, and no rule gives it an adapter")};
  return {not_installed(scene.machine)};
}

}  // namespace vitreo::machine
