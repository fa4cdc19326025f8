// What the checks share.
// SPDX-License-Identifier: Apache-2.0
#include "host/rig/machine/checks.h"

#include <algorithm>

namespace vitreo::machine {

std::vector<Need> Scene::needs(const std::vector<std::string>& buses) const {
  std::vector<Need> found;
  if (!wanted.rig) return found;
  for (const Need& need : wanted.rig->all)
    if (std::find(buses.begin(), buses.end(), need.address.bus) != buses.end())
      found.push_back(need);
  return found;
}

std::vector<Need> network_cameras(const Scene& scene) {
  std::vector<Need> found;
  for (const Need& need : scene.needs({"genicam"}))
    if (usb_camera(scene.devices, need) == nullptr) found.push_back(need);
  return found;
}

Finding nothing_plugged_in(const Scene& scene) {
  return scene.devices.seen ? said(State::good, "no instrument is plugged in")
                            : said(State::unknown, "/sys cannot be seen");
}

std::string listed(const std::vector<std::string>& names) {
  std::string text;
  for (std::size_t i = 0; i < names.size(); ++i)
    text += (i == 0 ? "" : i + 1 == names.size() ? " and " : ", ") + names[i];
  return text;
}

Finding not_installed(const Machine& machine) {
  return machine.has("/usr/bin") ? said(State::good, "not installed")
                                 : said(State::unknown, "/usr/bin cannot be seen");
}

bool is_masked(const Machine& machine, const std::string& unit) {
  return machine.link("/etc/systemd/system/" + unit) == "/dev/null";
}

}  // namespace vitreo::machine
