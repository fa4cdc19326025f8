// SPDX-License-Identifier: Apache-2.0
#include "host/rig/machine/doctor.h"

#include "host/rig/machine/checks.h"

#include <algorithm>

namespace vitreo::machine {
namespace {

/// A check, and the buses of which the rig must have one; empty: it concerns every rig that has an
/// instrument, or, with `always`, every one.
struct Row {
  const char* name;
  Findings (*check)(const Scene&);
  std::vector<std::string> buses;
  bool always = false;
  bool of_outputs = false;  // concerns rigs whose coils or lamp are real
};

const std::vector<Row>& rows_of_checks() {
  static const std::vector<Row> kRows{
      {"instruments", check_instruments, {}},
      {"groups", check_groups, {"serial", "hid", "usb", "video", "genicam", "usbtmc", "evdev"}},
      {"permissions",
       check_permissions,
       {"serial", "hid", "usb", "video", "genicam", "usbtmc", "evdev"}},
      {"udev_rules", check_udev_rules, {"serial", "hid", "usb", "genicam", "usbtmc", "evdev"}},
      {"modem_manager", check_modem_manager, {"serial"}},
      {"brltty", check_brltty, {"serial"}},
      {"ports_in_use", check_ports_in_use, {"serial", "hid", "usb", "video", "usbtmc", "evdev"}},
      {"usb_speed",
       check_usb_speed,
       {"serial", "hid", "usb", "video", "genicam", "usbtmc", "evdev"}},
      {"usb_power",
       check_usb_power,
       {"serial", "hid", "usb", "video", "genicam", "usbtmc", "evdev"}},
      {"usb_buffers", check_usb_buffers, {"genicam"}},
      {"socket_buffers", check_socket_buffers, {"genicam"}},
      {"network", check_network, {"genicam"}},
      {"sleep", check_sleep, {}},
      {"guardian", check_guardian, {}, false, true},
      {"priority", check_priority, {}, false, true},
      {"cpu_speed", check_cpu_speed, {}},
      {"cpu", check_cpu, {}, true},
      {"clock", check_clock, {}, true},
      {"disk", check_disk, {}, true},
  };
  return kRows;
}

bool concerns(const Row& row, const Scene& scene) {
  if (row.always) return true;
  if (!scene.rig()) return row.check != check_instruments;
  const auto& all = scene.wanted.rig->all;
  if (row.of_outputs)
    return std::any_of(all.begin(), all.end(), [](const Need& need) {
      return need.role == "coils" || need.role == "lamp";
    });
  const bool network = row.check == check_socket_buffers || row.check == check_network;
  if (network) return !network_cameras(scene).empty();
  return row.buses.empty() ? !all.empty() : !scene.needs(row.buses).empty();
}

}  // namespace

Findings examine(const Machine& machine, const Wanted& wanted) {
  Scene scene{machine, wanted, user_of(machine), find_devices(machine), {}};
  scene.uses = uses(machine, scene.devices, wanted.rig);
  Findings all;
  // What is odd of the rig's own file comes first; a file that is not says nothing.
  if (wanted.rig)
    for (const std::string& warning : wanted.rig->warnings)
      all.push_back({"rig", State::warning, warning});
  for (const Row& row : rows_of_checks()) {
    if (!concerns(row, scene)) continue;
    Findings found = row.check(scene);
    for (Finding& finding : found) finding.check = row.name;
    all.insert(all.end(), found.begin(), found.end());
  }
  return all;
}

std::vector<std::string> check_names() {
  std::vector<std::string> names;
  for (const Row& row : rows_of_checks()) names.emplace_back(row.name);
  return names;
}

}  // namespace vitreo::machine
