// The packaged udev rules against the drivers: whom they let in, and whom they keep out.
// SPDX-License-Identifier: Apache-2.0
#include "host/rig/machine/udev_rules.h"

#include "host/rig/machine/needs.h"
#include "host/rig/machine/udev_rule.h"
#include "host/rig/plugged_in.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <map>
#include <set>
#include <sstream>

namespace vitreo::machine {
namespace VITREO_TEST_FILE {

/// What a rule may ask of a device: "SUBSYSTEM", "ATTR{idVendor}" ...
using Device = std::map<std::string, std::string>;

Device usb_device(int vendor, int product, const std::string& interfaces = ":ff0000:") {
  const std::string v = fmt::format("{:04x}", vendor);
  const std::string p = fmt::format("{:04x}", product);
  return {{"SUBSYSTEM", "usb"},
          {"SUBSYSTEMS", "usb"},
          {"ACTION", "add"},
          {"ATTR{idVendor}", v},
          {"ATTRS{idVendor}", v},
          {"ATTR{idProduct}", p},
          {"ATTRS{idProduct}", p},
          {"ENV{DEVTYPE}", "usb_device"},
          {"ENV{ID_USB_INTERFACES}", interfaces}};
}

/// What the rules assign: {"MODE": "0660", "TAG": "uaccess", "ENV{...}": ...}. As udev(7) goes
/// through them: a rule whose comparisons all hold assigns, or jumps to a label.
Device assigned(const std::vector<std::vector<RuleTerm>>& rules, const Device& device) {
  Device made;
  std::string label;
  for (const auto& rule : rules) {
    if (!label.empty()) {
      if (rule[0].key == "LABEL" && rule[0].value == label) label.clear();
      continue;
    }
    bool holds = true;
    for (const RuleTerm& term : rule) {
      const std::string key = term.key + (term.of.empty() ? "" : "{" + term.of + "}");
      if (term.sign != "==" && term.sign != "!=") continue;
      if (term.key == "TEST") continue;  // each USB device has power/control
      const auto value = device.find(key);
      const bool fit = value != device.end() && fits(term.value, value->second);
      holds = holds && fit == (term.sign == "==");
    }
    for (const RuleTerm& term : rule) {
      if (!holds || term.sign == "==" || term.sign == "!=") continue;
      if (term.key == "GOTO") label = term.value;
      made[term.key + (term.of.empty() ? "" : "{" + term.of + "}")] = term.value;
    }
  }
  return made;
}

bool opened(const Device& made) {
  return made.contains("GROUP") && made.at("GROUP") == "plugdev" && made.at("MODE") == "0660" &&
         made.at("TAG") == "uaccess";
}

/// The numbers that rules or drivers name, with their neighbors: none of the patterns has a range.
std::set<int> numbers_of_interest(const std::vector<std::vector<RuleTerm>>& rules,
                                  const std::string& attribute) {
  std::set<int> numbers{0, 0xFFFF};
  const auto add = [&numbers](int number) {
    for (const int near : {number - 1, number, number + 1}) numbers.insert(near & 0xFFFF);
  };
  for (const auto& rule : rules)
    for (const RuleTerm& term : rule) {
      if (term.of != attribute) continue;
      EXPECT_EQ(term.value.find_first_of("*?["), std::string::npos) << term.value;
      std::istringstream all(term.value);
      for (std::string one; std::getline(all, one, '|');) add(std::stoi(one, nullptr, 16));
    }
  for (const int vendor : {0x09DB, 0x1FFB, 0x046D, 0x256F, 0x05F3})
    for (int product = 0; product <= 0xFFFF; ++product)
      if (attribute == "idProduct" && !driver_for(vendor, product).empty()) add(product);
  return numbers;
}

TEST(UdevRules, OpenEachInstrumentThatADriverTakesAndOfOtherMakersNothingElse) {
  const auto rules = read_rules(udev_rules());
  const auto products = numbers_of_interest(rules, "idProduct");
  int taken = 0;
  for (const int vendor : numbers_of_interest(rules, "idVendor"))
    for (const int product : products) {
      const bool ours = !driver_for(vendor, product).empty();
      taken += ours ? 1 : 0;
      // 3Dconnexion makes nothing but such devices; newer ones than the driver's list are let in.
      EXPECT_EQ(opened(assigned(rules, usb_device(vendor, product))), ours || vendor == 0x256F)
          << fmt::format("{:04x}:{:04x}", vendor, product);
    }
  EXPECT_EQ(taken, 34) << "1 USB-3103, 6 Tics, 11 and 10 SpaceMice, 6 pedals";
  EXPECT_TRUE(opened(assigned(rules, usb_device(0x2676, 0xBA02, ":ef0500:"))));
  EXPECT_TRUE(opened(assigned(rules, usb_device(0x1E10, 0x4000, ":ef0500:ef0501:ef0502:"))));
}

// A Metrolab THM1176 (USB488) and a meter of class USBTMC alone; a mass storage is none.
TEST(UdevRules, OpenUsbtmcInstrumentsByTheirClassAndTheirNodes) {
  const auto rules = read_rules(udev_rules());
  for (const char* interfaces : {":fe0301:", ":fe0300:", ":020201:0a0000:fe0301:"}) {
    const Device made = assigned(rules, usb_device(0x1BFA, 0x0498, interfaces));
    EXPECT_TRUE(opened(made)) << interfaces;
    EXPECT_EQ(made.at("ATTR{power/control}"), "on") << interfaces;
  }
  EXPECT_FALSE(opened(assigned(rules, usb_device(0x1BFA, 0x0498, ":080650:"))));
  EXPECT_FALSE(opened(assigned(rules, usb_device(0x1BFA, 0x0498, ":fe0101:")))) << "DFU";
  EXPECT_TRUE(opened(assigned(rules, {{"SUBSYSTEM", "usbmisc"}, {"KERNEL", "usbtmc0"}})));
  EXPECT_FALSE(opened(assigned(rules, {{"SUBSYSTEM", "usbmisc"}, {"KERNEL", "cdc-wdm0"}})));
}

TEST(UdevRules, OpenGamePadsAndNoKeyboards) {
  const auto rules = read_rules(udev_rules());
  const auto input = [&](const std::string& kernel, const std::string& what) {
    return opened(assigned(rules, {{"SUBSYSTEM", "input"},
                                   {"SUBSYSTEMS", "usb"},
                                   {"ATTRS{idVendor}", "045e"},
                                   {"KERNEL", kernel},
                                   {what, "1"}}));
  };
  EXPECT_TRUE(input("event5", "ENV{ID_INPUT_JOYSTICK}"));
  EXPECT_FALSE(input("event5", "ENV{ID_INPUT_KEYBOARD}"));
  EXPECT_FALSE(input("mouse0", "ENV{ID_INPUT_JOYSTICK}"));
}

TEST(UdevRules, KeepModemManagerFromSerialAdaptersAndNotFromModems) {
  const auto rules = read_rules(udev_rules());
  auto vendors = numbers_of_interest(rules, "idVendor");
  vendors.insert({0x12D1, 0x1199, 0x2C7C, 0x1BC7});  // Huawei, Sierra, Quectel, Telit
  int kept = 0;
  for (const int vendor : vendors) {
    UsbIdentity identity;
    identity.vendor = static_cast<std::uint16_t>(vendor);
    kept += is_serial_adapter(identity) ? 1 : 0;
    Device port = usb_device(vendor, 1);
    port["SUBSYSTEM"] = "tty";
    for (const Device& device : {usb_device(vendor, 1), port})
      EXPECT_EQ(assigned(rules, device).contains("ENV{ID_MM_DEVICE_IGNORE}"),
                is_serial_adapter(identity))
          << fmt::format("{:04x}", vendor);
  }
  EXPECT_EQ(kept, 10);
}

TEST(UdevRules, LetNoInstrumentSleep) {
  const auto rules = read_rules(udev_rules());
  const auto awake = [&rules](int vendor, int product, const std::string& interfaces) {
    const Device made = assigned(rules, usb_device(vendor, product, interfaces));
    return made.contains("ATTR{power/control}") && made.at("ATTR{power/control}") == "on";
  };
  EXPECT_TRUE(awake(0x09DB, 0x009C, ":030000:"));
  EXPECT_TRUE(awake(0x1FFB, 0x00B3, ":ff0000:"));
  EXPECT_TRUE(awake(0x0403, 0x6001, ":ffffff:"));
  EXPECT_TRUE(awake(0x2676, 0xBA02, ":ef0500:"));
  EXPECT_FALSE(awake(0x046D, 0x0825, ":0e0100:")) << "a webcam may";
}

TEST(UdevRules, DoNothingWhenADeviceGoes) {
  Device device = usb_device(0x09DB, 0x009C);
  device["ACTION"] = "remove";
  const Device made = assigned(read_rules(udev_rules()), device);
  EXPECT_EQ(made.size(), 1u) << "the jump alone";
}

TEST(UdevRules, AreReadAsUdevReadsThem) {
  const auto rules =
      read_rules("# a comment\n\n KERNEL==\"a|b*\", \\\n  ENV{X}+=\"1\"\nnonsense\n");
  ASSERT_EQ(rules.size(), 1u);
  EXPECT_EQ(rules[0],
            (std::vector<RuleTerm>{{"KERNEL", "", "==", "a|b*"}, {"ENV", "X", "+=", "1"}}));
  EXPECT_TRUE(fits("a|b*", "a"));
  EXPECT_TRUE(fits("a|b*", "bcd"));
  EXPECT_FALSE(fits("a|b*", "ab"));
  EXPECT_FALSE(fits("a|b*", ""));
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::machine
