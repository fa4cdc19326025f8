// Checks of programs that take serial ports for themselves: ModemManager, and whatever has an
// instrument open now (brltty: brltty.cpp).
// SPDX-License-Identifier: Apache-2.0
#include "host/rig/machine/checks.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <set>

namespace vitreo::machine {
namespace {

std::vector<Use> serial_uses(const Scene& scene) {
  std::vector<Use> found;
  for (const Use& use : scene.uses)
    if (use.bus == "serial" && use.usb != nullptr) found.push_back(use);
  return found;
}

bool rules_are_good(const Scene& scene) {
  for (const Finding& finding : check_udev_rules(scene))
    if (finding.state == State::fault || finding.state == State::warning) return false;
  return true;
}

/// CDC ACM, with one of the six protocols of AT commands (USB CDC 1.2, table 5): what ModemManager
/// probes also by its strict policy (its mm-filter.c).
bool looks_like_a_modem(const std::string& interface) {
  return interface.size() == 6 && interface.starts_with("02020") && interface[5] >= '1' &&
         interface[5] <= '6';
}

/// Keeps ModemManager from one kind of device that this version's rules do not name.
std::vector<std::string> ignore_device(const UsbIdentity& identity) {
  std::vector<std::string> commands{fmt::format(
      "echo 'SUBSYSTEMS==\"usb\", ATTRS{{idVendor}}==\"{:04x}\", ATTRS{{idProduct}}==\"{:04x}\", "
      "ENV{{ID_MM_DEVICE_IGNORE}}=\"1\"' | sudo tee -a /etc/udev/rules.d/61-laboratory.rules",
      identity.vendor, identity.product)};
  for (const std::string& one : apply_rules()) commands.push_back(one);
  return commands;
}

Finding check_modem_port(const Scene& scene, const Use& use, bool running) {
  const DeviceNode& node = *scene.devices.node(use.node);
  if (!node.record && !use.usb->record)
    return said(State::unknown, "udev's record of " + use.node + " (" + use.name +
                                    ") cannot be seen, so whether it is left alone is not known");
  const auto ignored = [](const std::optional<UdevRecord>& record) {
    return record && record->property("ID_MM_DEVICE_IGNORE") == "1";
  };
  if (ignored(node.record) || ignored(use.usb->record)) return said(State::good, use.node);
  const bool probed = looks_like_a_modem(node.interface);
  const auto mend = !is_serial_adapter(use.usb->identity) ? ignore_device(use.usb->identity)
                    : rules_are_good(scene)               ? apply_rules()
                                                          : install_rules(scene);
  return said(probed && running ? State::fault : State::warning,
              fmt::format("{} {} {} ({}): it says AT to what may be a modem",
                          running ? "runs, and" : "when it runs, it",
                          probed ? "probes" : "is not told to leave alone", use.node, use.name),
              mend);
}

/// Who has which node open, and how many processes cannot be looked into.
struct Holders {
  std::map<std::string, std::set<std::string>> of_node;  // "picocom (812)"
  std::size_t hidden = 0;
};
Holders holders_of(const Scene& scene, const std::set<std::string>& nodes) {
  Holders found;
  for (const Process& process : processes(scene.machine)) {
    if (scene.user && process.id == scene.user->process) continue;
    const std::string folder = "/proc/" + std::to_string(process.id) + "/fd";
    const auto files = scene.machine.list(folder);
    if (!files) {
      // A process that has ended meanwhile holds nothing.
      found.hidden += scene.machine.has("/proc/" + std::to_string(process.id)) ? 1 : 0;
      continue;
    }
    for (const std::string& file : *files) {
      const std::string target = scene.machine.link(folder + "/" + file);
      if (nodes.contains(target))
        found.of_node[target].insert(fmt::format("{} ({})", process.name, process.id));
    }
  }
  return found;
}

}  // namespace

// ID_MM_DEVICE_IGNORE: freedesktop.org, ModemManager reference, "Modem filter".
Findings check_modem_manager(const Scene& scene) {
  const bool running = runs(scene.machine, "ModemManager");
  if (!running && !scene.machine.has("/usr/sbin/ModemManager"))
    return {not_installed(scene.machine)};
  if (!running && is_masked(scene.machine, "ModemManager.service"))
    return {said(State::good, "masked")};
  const auto ports = serial_uses(scene);
  if (ports.empty()) {
    if (rules_are_good(scene))
      return {said(State::good, "kept from serial adapters by our udev rules")};
    return {said(State::warning,
                 std::string(running ? "runs" : "is installed") +
                     ", and will say AT to instruments that look like modems",
                 install_rules(scene))};
  }
  Findings found;
  std::vector<std::string> spared;
  for (const Use& use : ports) {
    const Finding finding = check_modem_port(scene, use, running);
    if (finding.state == State::good)
      spared.push_back(finding.found);
    else
      found.push_back(finding);
  }
  if (found.empty())
    found.push_back(said(State::good, "told to leave " + listed(spared) + " alone"));
  return found;
}

// What others have open is seen by root alone; where a part is hidden, nothing is claimed.
Findings check_ports_in_use(const Scene& scene) {
  std::set<std::string> nodes;
  for (const Use& use : scene.uses)
    if (!use.node.empty()) nodes.insert(use.node);
  if (nodes.empty()) return {nothing_plugged_in(scene)};
  if (!shows_processes(scene.machine))
    return {said(State::unknown, "/proc does not show the programs of other users")};
  const Holders holders = holders_of(scene, nodes);
  Findings found;
  for (const auto& [node, names] : holders.of_node) {
    const bool ours = std::all_of(names.begin(), names.end(), [](const std::string& name) {
      return name.starts_with("vitreo");
    });
    found.push_back(said(ours ? State::warning : State::fault,
                         node + " is open in " + listed({names.begin(), names.end()}) +
                             (ours ? ": a run or a prompt is going on" : "")));
  }
  if (!found.empty()) return found;
  const std::string all = fmt::format("{} node{}", nodes.size(), nodes.size() == 1 ? "" : "s");
  if (holders.hidden > 0)
    return {
        said(State::unknown,
             fmt::format("{}: open in no program of your own; the {} of other users are seen by "
                         "root alone",
                         all, holders.hidden),
             {"sudo fuser -v " + fmt::format("{}", fmt::join(nodes, " "))})};
  return {said(State::good, all + ", open in no program")};
}

}  // namespace vitreo::machine
