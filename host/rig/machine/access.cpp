// Checks of who may open the instruments' nodes: groups, permissions, udev rules.
// SPDX-License-Identifier: Apache-2.0
#include "host/rig/machine/checks.h"
#include "host/rig/machine/config_files.h"
#include "host/rig/machine/udev_rule.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <set>

namespace vitreo::machine {
namespace {

constexpr unsigned kReadAndWrite = 6;
constexpr const char* kRulesName = "60-vitreo.rules";
constexpr const char* kAsRoot = "run by root, who may do everything: run it as Vitreo's user";

/// The group that opens devices of this bus: that of a node which is there, else Debian's.
std::string group_of(const Scene& scene, const std::string& bus) {
  for (const Use& use : scene.uses) {
    if (use.bus != bus || use.node.empty()) continue;
    const auto rights = scene.machine.rights(use.node);
    const bool by_group = rights && rights->group != 0 && (rights->mode & 060) == 060;
    if (by_group) return group_name(scene.machine, rights->group);
  }
  return bus == "serial" ? "dialout" : bus == "video" ? "video" : "plugdev";
}

/// Groups and, of each, whether a node that is there stays closed without it.
std::map<std::string, bool> wanted_groups(const Scene& scene) {
  std::set<std::string> buses;
  for (const Need& need : scene.needs({"serial", "hid", "usb", "video", "usbtmc", "evdev"}))
    buses.insert(need.address.bus);
  if (!scene.rig()) buses = {"serial", "usb"};
  for (const Use& use : scene.uses) buses.insert(use.bus);
  std::map<std::string, bool> groups;
  for (const std::string& bus : buses) {
    bool nodes = false;
    bool closed = false;
    for (const Use& use : scene.uses) {
      if (use.bus != bus || use.node.empty()) continue;
      const auto rights = scene.machine.rights(use.node);
      if (!rights) continue;
      nodes = true;
      closed = closed || !may(*scene.user, *rights, kReadAndWrite);
    }
    // Nodes that are all open, by the seat's access list, want no group.
    if (!nodes || closed) groups[group_of(scene, bus)] |= closed;
  }
  return groups;
}

std::string joined(const std::vector<std::string>& names) {
  return fmt::format("{}", fmt::join(names, ","));
}

/// "/dev/hidraw0 (coils) is root:root 0600".
std::string closed_text(const Scene& scene, const Use& use, const Rights& rights) {
  return fmt::format("{} ({}) is {}:{} {:04o}", use.node, use.name,
                     user_name(scene.machine, rights.user), group_name(scene.machine, rights.group),
                     rights.mode);
}

const ConfigFile* rules_in_force(const std::vector<ConfigFile>& files) {
  for (const ConfigFile& file : files)
    if (file.path.ends_with(std::string("/") + kRulesName)) return &file;
  return nullptr;
}

/// What udev noted about the node that is opened.
const std::optional<UdevRecord>& record_of_use(const Scene& scene, const Use& use) {
  static const std::optional<UdevRecord> kNone;
  if (const DeviceNode* const node = scene.devices.node(use.node)) return node->record;
  return use.usb != nullptr ? use.usb->record : kNone;
}

/// The rules are in force; whether they were when each device was plugged in.
Finding check_applied(const Scene& scene, const std::string& file) {
  std::vector<std::string> late;
  std::vector<std::string> unseen;
  std::size_t applied = 0;
  for (const Use& use : scene.uses) {
    if (use.bus == "video" || use.usb == nullptr || use.node.empty()) continue;
    const auto& record = record_of_use(scene, use);
    if (!record)
      unseen.push_back(use.node);
    else if (record->has_tag("uaccess"))
      ++applied;
    else
      late.push_back(fmt::format("{} ({})", use.node, use.name));
  }
  if (!late.empty())
    return said(State::warning,
                file + " is not applied to " + listed(late) + ", plugged in before it came",
                apply_rules());
  if (!unseen.empty())
    return said(State::unknown, file + " is there; udev's record of " + listed(unseen) +
                                    " cannot be seen, so whether it is applied is not known");
  return said(State::good, applied == 0 ? file
                                        : fmt::format("{}, applied to {} device{}", file, applied,
                                                      applied == 1 ? "" : "s"));
}

}  // namespace

std::vector<std::string> apply_rules() {
  return {"sudo udevadm control --reload", "sudo udevadm trigger"};
}

std::vector<std::string> install_rules(const Scene& scene) {
  std::vector<std::string> commands{scene.wanted.program +
                                    " docs udev | sudo tee /etc/udev/rules.d/" + kRulesName +
                                    " >/dev/null"};
  for (const std::string& one : apply_rules()) commands.push_back(one);
  return commands;
}

// A group that was joined counts from the next login on.
Findings check_groups(const Scene& scene) {
  if (!scene.user) return {said(State::unknown, "/proc/self/status does not say who you are")};
  if (scene.user->opens_everything) return {said(State::unknown, kAsRoot)};
  const std::string name = user_name(scene.machine, scene.user->id);
  std::vector<std::string> in, later, out, none;
  bool closed = false;
  for (const auto& [group, shut] : wanted_groups(scene)) {
    const auto known = group_named(scene.machine, group);
    if (!known) {
      none.push_back(group);
    } else if (scene.user->groups.contains(known->id)) {
      in.push_back(group);
    } else if (known->members.contains(name)) {
      later.push_back(group);
    } else {
      out.push_back(group);
      closed = closed || shut;
    }
  }
  Findings found;
  for (const std::string& group : none)
    found.push_back(
        said(State::warning, "there is no group " + group + " on this machine",
             {"sudo groupadd --system " + shell_word(group),
              "sudo usermod -aG " + shell_word(group) + " \"$USER\"  # then log out and in"}));
  if (!later.empty())
    found.push_back(said(
        State::fault,
        name + " was put into " + listed(later) + " after this session began: log out and in again",
        {"newgrp " + shell_word(later.front()) + "  # until then, in this terminal"}));
  if (!out.empty())
    found.push_back(said(
        closed ? State::fault : State::warning, name + " is not in " + listed(out),
        {"sudo usermod -aG " + shell_word(joined(out)) + " \"$USER\"  # then log out and in"}));
  if (found.empty())
    found.push_back(said(
        State::good, in.empty() ? "what is plugged in wants none" : name + " is in " + listed(in)));
  return found;
}

Findings check_permissions(const Scene& scene) {
  if (!scene.user) return {said(State::unknown, "/proc/self/status does not say who you are")};
  std::vector<std::string> open, closed, unseen;
  bool by_group = true;
  for (const Use& use : scene.uses) {
    if (use.node.empty()) continue;
    const auto rights = scene.machine.rights(use.node);
    if (!rights) {
      unseen.push_back(use.node);
      continue;
    }
    if (may(*scene.user, *rights, kReadAndWrite)) {
      open.push_back(use.node);
      continue;
    }
    closed.push_back(closed_text(scene, use, *rights));
    by_group = by_group && rights->group != 0 && (rights->mode & 060) == 060;
  }
  Findings found;
  if (!closed.empty())
    found.push_back(said(State::fault, "may not be opened: " + listed(closed),
                         by_group ? std::vector<std::string>{} : install_rules(scene)));
  if (!unseen.empty()) found.push_back(said(State::unknown, "cannot be seen: " + listed(unseen)));
  if (!found.empty()) return found;
  if (scene.user->opens_everything && !open.empty()) return {said(State::unknown, kAsRoot)};
  if (open.empty()) return {nothing_plugged_in(scene)};
  return {said(State::good, listed(open) + " may be opened")};
}

// Serial ports do without these rules, by their group; the others do not.
Findings check_udev_rules(const Scene& scene) {
  const auto files = config_files(scene.machine, "udev/rules.d");
  const ConfigFile* const file = rules_in_force(files);
  const bool only_serial =
      scene.rig() && scene.needs({"hid", "usb", "genicam", "usbtmc", "evdev"}).empty();
  if (file == nullptr)
    return {said(only_serial ? State::warning : State::fault,
                 std::string(kRulesName) + " is not installed", install_rules(scene))};
  if (file->masked)
    return {said(State::fault, file->path + " switches the rules off",
                 {"sudo rm " + shell_word(file->path), apply_rules()[0], apply_rules()[1]})};
  if (file->text.empty()) return {said(State::unknown, file->path + " cannot be read")};
  if (read_rules(file->text) != read_rules(scene.wanted.rules))
    return {
        said(State::warning, file->path + " is not that of this version", install_rules(scene))};
  return {check_applied(scene, file->path)};
}

}  // namespace vitreo::machine
