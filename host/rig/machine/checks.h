// Checks of the doctor: each looks at one thing and returns one finding or several. Sources of what
// they hold against: docs/how-to/doctor.md.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/rig/machine/devices.h"
#include "host/rig/machine/finding.h"
#include "host/rig/machine/machine.h"
#include "host/rig/machine/wanted.h"

#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace vitreo::machine {

/// What all checks look at; read once.
struct Scene {
  const Machine& machine;
  const Wanted& wanted;
  std::optional<User> user;
  Devices devices;
  std::vector<Use> uses;

  bool rig() const { return wanted.rig.has_value(); }
  /// Of the rig, those on one of these buses; without a rig none.
  std::vector<Need> needs(const std::vector<std::string>& buses) const;
};

/// Of a check that had no device to look at.
Finding nothing_plugged_in(const Scene& scene);

/// A finding whose check's name is not set yet.
inline Finding said(State state, std::string found, std::vector<std::string> mend = {}) {
  return {"", state, std::move(found), std::move(mend)};
}

// Who may open the devices (access.cpp).
Findings check_groups(const Scene& scene);
Findings check_permissions(const Scene& scene);
Findings check_udev_rules(const Scene& scene);
/// Commands that put this version's rules in force.
std::vector<std::string> install_rules(const Scene& scene);
/// Commands that apply changed rules to what is plugged in.
std::vector<std::string> apply_rules();

// Who else takes them (rivals.cpp, brltty.cpp).
Findings check_modem_manager(const Scene& scene);
Findings check_brltty(const Scene& scene);
Findings check_ports_in_use(const Scene& scene);

// The rig's instruments, and USB (instruments.cpp, usb.cpp).
Findings check_instruments(const Scene& scene);
Findings check_usb_speed(const Scene& scene);
Findings check_usb_power(const Scene& scene);
Findings check_usb_buffers(const Scene& scene);

// Cameras on the network (network.cpp).
Findings check_socket_buffers(const Scene& scene);
Findings check_network(const Scene& scene);

// The computer itself (sleep.cpp, computer.cpp).
Findings check_sleep(const Scene& scene);
Findings check_guardian(const Scene& scene);
Findings check_clock(const Scene& scene);
Findings check_cpu(const Scene& scene);
Findings check_cpu_speed(const Scene& scene);
Findings check_priority(const Scene& scene);
Findings check_disk(const Scene& scene);

/// Of a program that has none of its files; unknown where files cannot be seen.
Finding not_installed(const Machine& machine);
/// Whether the administrator has forbidden a unit of systemd.
bool is_masked(const Machine& machine, const std::string& unit);

/// A camera that may be on the network: no USB one by what is plugged in.
std::vector<Need> network_cameras(const Scene& scene);

/// "a, b and c".
std::string listed(const std::vector<std::string>& names);

}  // namespace vitreo::machine
