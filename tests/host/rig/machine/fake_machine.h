// Fake machine: a folder with the files by which a Linux system says how it is set up. As it is
// made it is a laboratory's computer on which everything is as it should be.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/rig/machine/doctor.h"
#include "tests/host/rig/fake_rig.h"

#include <fmt/format.h>

#include <filesystem>
#include <fstream>
#include <string>
#include <sys/stat.h>
#include <unistd.h>

namespace vitreo::machine {

class FakeMachine {
 public:
  FakeMachine();

  void write(const std::string& path, const std::string& text) const {
    std::filesystem::create_directories(at(path).parent_path());
    std::ofstream(at(path)) << text;
  }
  void link(const std::string& path, const std::string& target) const {
    std::filesystem::create_directories(at(path).parent_path());
    std::filesystem::remove(at(path));
    std::filesystem::create_symlink(target, at(path));
  }
  void remove(const std::string& path) const { std::filesystem::remove_all(at(path)); }
  /// A node below /dev; a plain file, since nothing opens it. Its group is a number of Debian's
  /// where the test may give one; else it is the test's own, of which /etc/group tells.
  void node(const std::string& path, const std::string& group, unsigned mode = 0660) const {
    write(path, "");
    if (chown(at(path).c_str(), 0, number_of(group)) != 0) own_group_ = true;
    chmod(at(path).c_str(), mode);
  }
  std::filesystem::path at(const std::string& path) const {
    return folder_.path() / std::filesystem::path(path).relative_path();
  }
  /// In `groups` of those below.
  void user_in(const std::string& groups) const;
  void user_as_root() const {
    write("/proc/self/status",
          "Pid:\t900\nUid:\t0\t0\t0\t0\nGid:\t0\t0\t0\t0\nGroups:\t\n"
          "CapEff:\t000001ffffffffff\n");
  }
  void process(int id, const std::string& name) const {
    write(fmt::format("/proc/{}/comm", id), name + "\n");
    std::filesystem::create_directories(at(fmt::format("/proc/{}/fd", id)));
  }
  /// A USB device on the root hub, "1-2", with one interface.
  struct Usb {
    std::string place, vendor, product, serial, maker, name;
    std::string interface = "ff0000";
    std::string speed = "12";
    std::string version = " 2.00";
  };
  void plug(const Usb& usb) const;
  void unplug(const std::string& place) const;
  /// The node of class "tty", "hidraw", "video4linux", "usbmisc" or "input" that a USB device has.
  void give_node(const std::string& place, const std::string& kind, const std::string& name,
                 const std::string& numbers) const;
  void udev(const std::string& numbers, const std::string& record) const {
    write("/run/udev/data/c" + numbers, record);
  }

  Machine machine() const {
    return Machine(folder_.path(),
                   {[this] { return clock; }, [this](const auto&) { return free; }});
  }

  std::optional<bool> clock = true;
  std::optional<std::uint64_t> free = 500'000'000'000;

 private:
  static gid_t number_of(const std::string& group) {
    return group == "dialout" ? 1020 : group == "plugdev" ? 1046 : group == "video" ? 1044 : 0;
  }
  mutable bool own_group_ = false;  // this test may not give files to others
  TemporaryFolder folder_;
};

/// What a laboratory's rig names: all of it is plugged into a FakeMachine.
RigNeeds laboratory_needs();
Wanted wanted_without_rig();
Wanted wanted_for_laboratory();

}  // namespace vitreo::machine
