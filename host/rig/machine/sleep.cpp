// Check of what may put the machine to sleep: a sleeping host and guardian leave the outputs as
// they are.
// SPDX-License-Identifier: Apache-2.0
#include "host/rig/machine/checks.h"
#include "host/rig/machine/config_files.h"

#include <fmt/format.h>

#include <array>
#include <cstdlib>
#include <map>
#include <sstream>

namespace vitreo::machine {
namespace {

using Settings = std::map<std::string, std::string>;

void add_settings(Settings& settings, const std::string& text) {
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    const auto sign = line.find('=');
    if (sign == std::string::npos || line.starts_with('#') || line.starts_with(';')) continue;
    std::istringstream key(line.substr(0, sign)), value(line.substr(sign + 1));
    std::string name, what;
    key >> name;
    value >> what;
    settings[name] = what;
  }
}

/// Of "logind.conf" or "sleep.conf": the main file, then the drop-ins, of which the last by name
/// wins (logind.conf(5)). The keys of both files' sections are distinct.
Settings systemd_settings(const Machine& machine, const std::string& name) {
  Settings settings;
  for (const char* const folder : {"/etc/", "/run/", "/usr/local/lib/", "/usr/lib/"}) {
    const auto text = machine.read(folder + std::string("systemd/") + name);
    if (!text) continue;
    add_settings(settings, *text);
    break;
  }
  for (const ConfigFile& file : config_files(machine, "systemd/" + name + ".d"))
    if (file.path.ends_with(".conf") && !file.masked) add_settings(settings, file.text);
  return settings;
}

std::string setting(const Settings& settings, const std::string& name, const std::string& usual) {
  const auto found = settings.find(name);
  return found == settings.end() || found->second.empty() ? usual : found->second;
}

bool says_no(const std::string& word) {
  return word == "no" || word == "false" || word == "off" || word == "0" || word == "n" ||
         word == "f";
}

/// Why it cannot sleep; "" when it can.
std::string kept_awake(const Machine& machine) {
  if (machine.line("/sys/power/state").empty()) return "the kernel of this machine cannot sleep";
  for (const char* const target : {"sleep.target", "suspend.target"})
    for (const char* const folder : {"/etc/systemd/system/", "/run/systemd/system/"})
      if (machine.link(folder + std::string(target)) == "/dev/null")
        return std::string(target) + " is masked";
  const Settings sleep = systemd_settings(machine, "sleep.conf");
  return says_no(setting(sleep, "AllowSuspend", "yes")) ? "AllowSuspend=no" : "";
}

/// SW_LID is bit 0 of the switches (linux/input-event-codes.h), whose last word has the lowest
/// bits.
bool has_lid(const Machine& machine) {
  for (const std::string& name :
       machine.list("/sys/class/input").value_or(std::vector<std::string>{})) {
    const std::string bits = machine.line("/sys/class/input/" + name + "/capabilities/sw");
    const auto last = bits.find_last_of(' ');
    const std::string word = last == std::string::npos ? bits : bits.substr(last + 1);
    if ((std::strtoull(word.c_str(), nullptr, 16) & 1) != 0) return true;
  }
  return machine.has("/proc/acpi/button/lid");
}

bool sleeps(const std::string& action) {
  return action.starts_with("suspend") || action.starts_with("hiber") ||
         action.starts_with("hybrid") || action == "sleep";
}

/// What of systemd's own settings puts it to sleep: "closing the lid", "15 min without input".
std::vector<std::string> triggers(const Machine& machine) {
  const Settings login = systemd_settings(machine, "logind.conf");
  const std::string lid = setting(login, "HandleLidSwitch", "suspend");
  std::vector<std::string> found;
  if (has_lid(machine) &&
      (sleeps(lid) || sleeps(setting(login, "HandleLidSwitchExternalPower", lid))))
    found.emplace_back("closing the lid");
  if (sleeps(setting(login, "IdleAction", "ignore")))
    found.push_back(setting(login, "IdleActionSec", "30min") + " without input");
  return found;
}

/// Desktops that suspend an idle session by settings of the user's own.
std::vector<std::string> desktops(const Machine& machine) {
  constexpr std::array<std::array<const char*, 2>, 4> kDesktops{{{"gsd-power", "GNOME"},
                                                                 {"org_kde_powerde", "KDE Plasma"},
                                                                 {"xfce4-power-man", "Xfce"},
                                                                 {"mate-power-mana", "MATE"}}};
  std::vector<std::string> found;
  for (const auto& [process, name] : kDesktops)
    if (runs(machine, process)) found.emplace_back(name);
  return found;
}

/// Who holds sleep off at present: /run/systemd/inhibit has a file for each inhibitor.
std::vector<std::string> inhibitors(const Machine& machine) {
  std::vector<std::string> found;
  for (const std::string& name :
       machine.list("/run/systemd/inhibit").value_or(std::vector<std::string>{})) {
    Settings lock;
    add_settings(lock, machine.read("/run/systemd/inhibit/" + name).value_or(""));
    const bool blocks = lock["MODE"] == "block" && lock["WHAT"].find("sleep") != std::string::npos;
    if (blocks) found.push_back(lock["WHO"]);
  }
  return found;
}

// logind asks sleep.conf at each lid and idle action, and so do the desktops through it
// (systemd-sleep.conf(5)): one file for all of them. Masked targets alone would make logind try
// again and again.
std::vector<std::string> forbid_sleep() {
  return {"sudo mkdir -p /etc/systemd/sleep.conf.d",
          "printf '[Sleep]\\nAllowSuspend=no\\nAllowHibernation=no\\nAllowHybridSleep=no\\n"
          "AllowSuspendThenHibernate=no\\n' | sudo tee /etc/systemd/sleep.conf.d/60-vitreo.conf"};
}

}  // namespace

Findings check_sleep(const Scene& scene) {
  const Machine& machine = scene.machine;
  if (!machine.has("/sys/power/state"))
    return {said(State::unknown, "/sys/power/state is not there, as in a container")};
  if (const std::string why = kept_awake(machine); !why.empty()) return {said(State::good, why)};
  const bool systemd = machine.has("/run/systemd/system");
  if (!systemd)
    return {said(State::unknown, "systemd does not run here: what puts it to sleep is not known")};
  const auto by = triggers(machine);
  const auto held = inhibitors(machine);
  const std::string now = held.empty() ? "" : "; held off at present by " + listed(held);
  if (!by.empty())
    return {said(State::fault,
                 listed(by) + " puts it to sleep: host and guardian stop, currents stay" + now,
                 forbid_sleep())};
  if (const auto some = desktops(machine); !some.empty())
    return {said(
        State::unknown,
        listed(some) + " may suspend an idle session, by settings that are not seen here" + now,
        forbid_sleep())};
  return {said(State::good, "neither lid nor idleness puts it to sleep")};
}

}  // namespace vitreo::machine
