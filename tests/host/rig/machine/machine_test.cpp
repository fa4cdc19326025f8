// Files, links and rights of a machine below a root folder; the devices and needs found in them.
// SPDX-License-Identifier: Apache-2.0
#include "host/rig/machine/machine.h"

#include "host/rig/machine/needs.h"
#include "tests/host/rig/machine/fake_machine.h"

#include <gtest/gtest.h>

#include <cstring>

namespace vitreo::machine {
namespace VITREO_TEST_FILE {

User user_in_group(unsigned id, std::set<unsigned> groups) {
  User user;
  user.id = id;
  user.groups = std::move(groups);
  return user;
}

/// Entries of acl(5) as the kernel keeps them: version 2, then tag, permissions, id.
std::string acl(const std::vector<std::array<std::uint32_t, 3>>& entries) {
  std::string bytes("\x02\0\0\0", 4);
  for (const auto& [tag, permissions, id] : entries) {
    const std::uint16_t small[2] = {static_cast<std::uint16_t>(tag),
                                    static_cast<std::uint16_t>(permissions)};
    bytes.append(reinterpret_cast<const char*>(small), sizeof small);
    bytes.append(reinterpret_cast<const char*>(&id), sizeof id);
  }
  return bytes;
}

TEST(Machine, FollowsLinksWithinItsRoot) {
  const FakeMachine fake;
  const Machine machine = fake.machine();
  fake.link("/dev/serial/by-id/one", "../../ttyUSB0");
  fake.link("/lib", "/usr/lib");  // absolute, as on a merged /usr
  fake.link("/loop", "loop");
  fake.link("/gone", "nowhere");
  EXPECT_EQ(machine.real("/dev/serial/by-id/one"), "/dev/ttyUSB0");
  EXPECT_EQ(machine.real("/lib/udev/rules.d/../rules.d/60-vitreo.rules"),
            "/usr/lib/udev/rules.d/60-vitreo.rules");
  EXPECT_EQ(machine.real("/sys/class/tty/ttyUSB0"),
            "/sys/devices/pci0000:00/0000:00:14.0/usb1/1-3/1-3:1.0/tty/ttyUSB0");
  EXPECT_EQ(machine.real("/../../etc/group"), "/etc/group") << "there is nothing above the root";
  EXPECT_EQ(machine.real("/loop"), "");
  EXPECT_EQ(machine.real("/gone"), "");
}

TEST(Machine, TellsAFileThatIsNotThereFromAnEmptyOne) {
  const FakeMachine fake;
  fake.write("/etc/empty", "");
  EXPECT_EQ(fake.machine().read("/etc/empty"), "");
  EXPECT_FALSE(fake.machine().read("/etc/nothing"));
  EXPECT_FALSE(fake.machine().read("/etc")) << "a folder has no text";
  EXPECT_FALSE(fake.machine().list("/etc/empty")) << "a file has no names";
  EXPECT_EQ(fake.machine().line("/proc/sys/net/core/rmem_max"), "16777216");
}

TEST(Machine, RightsAreThoseOfTheFirstClassThatFits) {
  const Rights dialout{0660, 0, 20, ""};
  EXPECT_TRUE(may(user_in_group(7, {20}), dialout, 6));
  EXPECT_FALSE(may(user_in_group(7, {21}), dialout, 6));
  EXPECT_TRUE(may(user_in_group(0, {}), dialout, 6)) << "the owner";
  EXPECT_FALSE(may(user_in_group(7, {20}), {0606, 0, 20, ""}, 6))
      << "a member is held to the group's bits, though others may";
  EXPECT_FALSE(may(user_in_group(7, {20}), {0640, 0, 20, ""}, 6)) << "reading is not enough";
  User root = user_in_group(0, {0});
  root.opens_everything = true;
  EXPECT_TRUE(may(root, {0000, 7, 7, ""}, 6));
}

// The lists that systemd-logind gives nodes with the tag uaccess: user::rw-, user:7:rw-,
// group::rw-, mask::rw-, other::---.
TEST(Machine, RightsOfAnAccessListAreThoseOfItsEntries) {
  constexpr std::uint32_t kNone = 0xFFFFFFFF;
  const auto list = [&](std::uint32_t mask) {
    return Rights{0660, 0, 20,
                  acl({{1, 6, kNone},
                       {2, 6, 7},
                       {4, 6, kNone},
                       {8, 4, 30},
                       {16, mask, kNone},
                       {32, 0, kNone}})};
  };
  EXPECT_TRUE(may(user_in_group(7, {}), list(6), 6)) << "named";
  EXPECT_FALSE(may(user_in_group(8, {}), list(6), 6)) << "not named";
  EXPECT_FALSE(may(user_in_group(7, {}), list(4), 6)) << "masked";
  EXPECT_TRUE(may(user_in_group(8, {20}), list(6), 6)) << "the file's group";
  EXPECT_FALSE(may(user_in_group(8, {30}), list(6), 6)) << "a group that may only read";
  EXPECT_TRUE(may(user_in_group(8, {30}), list(6), 4));
}

TEST(Machine, AnAccessListCutOffIsReadAsFarAsItGoes) {
  const std::string whole = acl({{1, 6, 0}, {2, 6, 7}});
  for (std::size_t size = 0; size < whole.size(); ++size)
    EXPECT_FALSE(may(user_in_group(7, {}), {0600, 0, 0, whole.substr(0, size)}, 6)) << size;
}

TEST(Devices, AreReadFromSysfs) {
  const FakeMachine fake;
  const Devices devices = find_devices(fake.machine());
  EXPECT_EQ(devices.usb.size(), 5u) << "without the hub";
  const UsbDevice* const coils = devices.at("1-1");
  ASSERT_NE(coils, nullptr);
  EXPECT_EQ(coils->identity.vendor, 0x09DB);
  EXPECT_EQ(coils->identity.serial, "01A2B3C4");
  EXPECT_EQ(coils->name(), "MCC USB-3103");
  EXPECT_EQ(coils->speed, 12e6);
  EXPECT_EQ(coils->node, "/dev/bus/usb/001/002");
  EXPECT_EQ(coils->hubs, std::vector<std::string>{"usb1"});
  EXPECT_EQ(coils->may_sleep, false);
  EXPECT_TRUE(devices.at("1-4")->is_usb3_vision());
  const DeviceNode* const port = devices.node("/dev/ttyUSB0");
  ASSERT_NE(port, nullptr);
  EXPECT_EQ(port->usb, "1-3");
  EXPECT_EQ(port->interface, "ff0000");
  ASSERT_TRUE(port->record);
  EXPECT_EQ(port->record->property("ID_MM_DEVICE_IGNORE"), "1");
  EXPECT_EQ(port->record->property("ID_MM"), "");
  EXPECT_TRUE(port->record->has_tag("uaccess"));
  EXPECT_FALSE(port->record->has_tag("u"));
}

TEST(Devices, AConsoleAndAPortWithoutAUsbAdapterAreNoneOfThem) {
  const FakeMachine fake;
  fake.write("/sys/devices/virtual/tty/tty0/dev", "4:0\n");
  fake.link("/sys/class/tty/tty0", "../../devices/virtual/tty/tty0");
  fake.write("/sys/devices/platform/serial8250/tty/ttyS0/dev", "4:64\n");
  fake.link("/sys/class/tty/ttyS0", "../../devices/platform/serial8250/tty/ttyS0");
  EXPECT_EQ(find_devices(fake.machine()).nodes.size(), 3u) << "hidraw0, ttyUSB0, video0";
}

TEST(Needs, AreTheRigsAddressesOutsideTheProgram) {
  RigDescription rig;
  rig.file = "lab.lua";
  rig.table["coils"] = {ConfigTable{{"driver", {"kepco_bop"}},
                                    {"address",
                                     {"tcp:10.0.0.11:5025, tcp:10.0.0.12:5025, tcp:10.0.0.13:5025, "
                                      "tcp:10.0.0.14:5025, tcp:10.0.0.15:5025, tcp:10.0.0.16:5025, "
                                      "tcp:10.0.0.17:5025, tcp:10.0.0.18:5025"}}}};
  rig.table["stage"] = {
      ConfigTable{{"driver", {"sutter_mp285"}}, {"address", {"serial:/dev/ttyUSB0"}}}};
  rig.table["lens_mover"] = {ConfigTable{{"driver", {"pololu_tic"}}, {"address", {"emulated"}}}};
  rig.table["top_camera"] = {ConfigTable{{"driver", {"genicam"}},
                                         {"address", {"genicam:192.168.1.7"}},
                                         {"effective_pixel", {10e-6}},
                                         {"width_px", {1000.0}},
                                         {"height_px", {500.0}},
                                         {"frame_rate", {10.0}}}};
  const RigNeeds needs = needs_of(rig);
  std::map<std::string, int> roles;
  for (const Need& need : needs.all) ++roles[need.role];
  EXPECT_EQ(roles, (std::map<std::string, int>{{"coils", 8}, {"stage", 1}, {"top_camera", 1}}));
  const Need& camera = needs.all.back();
  EXPECT_EQ(camera.address.place, "192.168.1.7");
  EXPECT_DOUBLE_EQ(camera.bytes_per_second, 1000.0 * 500.0 * 10.0);
  EXPECT_EQ(camera.packet_size, 1400) << "the driver's own";
  EXPECT_EQ(camera.socket_buffer, 4 << 20) << "the driver's own";
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::machine
