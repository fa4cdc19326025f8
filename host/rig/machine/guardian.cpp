// Check of the guardian's control group: whether what kills the host's as a whole leaves the
// guardian alive.
// SPDX-License-Identifier: Apache-2.0
#include "host/rig/machine/checks.h"

#include <fmt/format.h>

#include <sstream>
#include <string>

namespace vitreo::machine {
namespace {

/// Below the hierarchy's root: the line "0::/user.slice/..." (cgroups(7)); empty without version 2.
std::string group_in(const std::string& text) {
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);)
    if (line.starts_with("0::")) return line.substr(3);
  return "";
}

bool has_systemd_run(const Machine& machine) {
  return machine.has("/usr/bin/systemd-run") || machine.has("/bin/systemd-run");
}

/// The manager that can make a scope: the system's for root, else the user's own.
bool manager_runs(const Machine& machine, unsigned user) {
  if (!machine.has("/run/systemd/system")) return false;
  return user == 0 || machine.has(fmt::format("/run/user/{}/systemd/private", user));
}

}  // namespace

// Without a manager the guardian tries to move itself, for which it needs the right to write in the
// hierarchy: root has it, a user in what was delegated to him, which is not seen in files.
Findings check_guardian(const Scene& scene) {
  const Machine& machine = scene.machine;
  const auto& user = scene.user;
  if (!user) return {said(State::unknown, "/proc/self/status does not tell the user")};
  const auto told = machine.read("/proc/self/cgroup");
  if (!told) return {said(State::unknown, "/proc/self/cgroup does not tell the control group")};
  const std::string group = group_in(*told);
  if (group.empty() || group == "/")
    return {said(State::good, "the program is in no control group that could be killed")};
  if (manager_runs(machine, user->id) && has_systemd_run(machine))
    return {said(State::good, "systemd gives the guardian a scope of its own")};
  if (user->id == 0) return {said(State::good, "the guardian moves to a control group of its own")};
  return {
      said(State::warning, fmt::format("no systemd of this user's: what kills the control group "
                                       "{} kills host and guardian; a heartbeat line guards then "
                                       "(docs/how-to/heartbeat_line.md)",
                                       group))};
}

}  // namespace vitreo::machine
