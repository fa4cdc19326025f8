// Debian's udev with the project's rules: groups, modes, names and properties of the nodes.
// SPDX-License-Identifier: Apache-2.0
#include "devices/links/serial_ports.h"
#include "tests/kernel/guest.h"

#include <gtest/gtest.h>

#include <grp.h>
#include <sys/stat.h>

namespace vitreo::kernel_guest {
namespace {

namespace fs = std::filesystem;

class UdevGuest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    load_gadgets();
    load({"usb_f_hid", "usbhid", "hid-generic", "usb_f_acm", "cdc-acm"});
    start_udevd();
  }
};

void settle() { run({"udevadm", "settle", "--timeout=20"}); }

/// "0660 plugdev"
std::string rights(const fs::path& node) {
  struct stat found {};
  if (::stat(node.c_str(), &found) != 0) return "no " + node.string();
  char mode[8];
  std::snprintf(mode, sizeof mode, "%04o", found.st_mode & 07777U);
  const group* const its = ::getgrgid(found.st_gid);
  return std::string(mode) + " " + (its != nullptr ? its->gr_name : "?");
}

/// The properties that udev noted of a node.
std::string properties(const fs::path& node) {
  return run({"udevadm", "info", "--query=property", "--name=" + node.string()}).said;
}
bool is_ignored(const fs::path& node) {
  return properties(node).find("ID_MM_DEVICE_IGNORE=1") != std::string::npos;
}

/// power/control of the device with that vendor.
std::string power(const std::string& vendor) {
  for (const auto& entry : fs::directory_iterator("/sys/bus/usb/devices"))
    if (text_of(entry.path() / "idVendor") == vendor + "\n")
      return text_of(entry.path() / "power/control");
  return "no device";
}

TEST_F(UdevGuest, GivesTheOperatorTheCoilInterface) {
  Gadget device({"hid", "usb3103", "--numbered"});
  ASSERT_TRUE(time_until(5s, [] { return fs::exists("/dev/hidraw0"); }));
  settle();
  EXPECT_EQ(rights("/dev/hidraw0"), "0660 plugdev");
  EXPECT_NE(properties("/dev/hidraw0").find("uaccess"), std::string::npos);
  EXPECT_EQ(power("09db"), "on\n");
  const Ended listed = run({kProgram, "devices"}, kOperator);
  EXPECT_NE(listed.said.find("hid:09db:009c"), std::string::npos) << listed.said;
  write_text("/tmp/rig.lua",
             "return { title = 'r', coils = { driver = 'usb3103', address = 'hid:09db:009c' } }");
  const Ended opened = run({kProgram, "devices", "--rig", "/tmp/rig.lua"}, kOperator);
  EXPECT_EQ(opened.code, 0) << opened.said;
  row("hidraw0 %s, autosuspend %s", rights("/dev/hidraw0").c_str(), "off");
}

TEST_F(UdevGuest, KeepsModemManagerFromSerialAdaptersAndGivesThemALastingName) {
  Gadget device({"acm", "kepco_bop", "--usb-id", "0403:6001"});
  ASSERT_TRUE(time_until(5s, [] { return fs::exists("/dev/ttyACM0"); }));
  settle();
  EXPECT_EQ(rights("/dev/ttyACM0"), "0660 dialout");
  EXPECT_TRUE(is_ignored("/dev/ttyACM0")) << properties("/dev/ttyACM0");
  EXPECT_EQ(power("0403"), "on\n");
  std::string name;
  for (const auto& entry : fs::directory_iterator("/dev/serial/by-id"))
    if (is_lasting_link(entry.path().filename().string())) name = entry.path().string();
  ASSERT_FALSE(name.empty());
  EXPECT_EQ(fs::canonical(name), "/dev/ttyACM0");
  write_text(
      "/tmp/rig.lua",
      "return { title = 'r', coils = { driver = 'kepco_bop', address = 'serial:" + name + "' } }");
  const Ended opened = run({kProgram, "devices", "--rig", "/tmp/rig.lua"}, kOperator);
  EXPECT_EQ(opened.code, 0) << opened.said;
  row("ttyACM0 %s, %s", rights("/dev/ttyACM0").c_str(), name.c_str());
}

TEST_F(UdevGuest, LeavesAStrangersModemAlone) {
  Gadget device({"acm", "kepco_bop", "--usb-id", "1d6b:0104"});
  ASSERT_TRUE(time_until(5s, [] { return fs::exists("/dev/ttyACM0"); }));
  settle();
  EXPECT_FALSE(is_ignored("/dev/ttyACM0")) << properties("/dev/ttyACM0");
}

TEST_F(UdevGuest, DoctorFindsTheRulesInForceAndNoLogind) {
  Gadget device({"hid", "usb3103", "--numbered"});
  ASSERT_TRUE(time_until(5s, [] { return fs::exists("/dev/hidraw0"); }));
  settle();
  write_text("/tmp/rig.lua",
             "return { title = 'r', coils = { driver = 'usb3103', address = 'hid:09db:009c' } }");
  const Ended doctor = run({kProgram, "doctor", "--rig", "/tmp/rig.lua", "--json"}, kOperator);
  const nlohmann::json findings = nlohmann::json::parse(doctor.said, nullptr, false);
  ASSERT_TRUE(findings.is_array()) << doctor.said;
  std::string sleep;
  for (const nlohmann::json& one : findings) {
    const auto check = one.at("check").get<std::string>();
    const auto state = one.at("state").get<std::string>();
    const bool ours = check == "udev_rules" || check == "permissions" || check == "instruments";
    EXPECT_TRUE(!ours || state == "good") << one.dump();
    if (check == "sleep") sleep = state + ": " + one.at("found").dump();
  }
  EXPECT_FALSE(sleep.empty()) << doctor.said;
  EXPECT_NE(sleep.substr(0, 4), "good") << sleep;  // there is no logind that could keep it awake
  row("doctor, of sleep: %s", sleep.c_str());
}

}  // namespace
}  // namespace vitreo::kernel_guest
