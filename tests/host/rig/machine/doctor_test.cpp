// The doctor on machines that are set up well, and on such ones with one thing spoiled: the check
// of that thing says so, and no other.
// SPDX-License-Identifier: Apache-2.0
#include "host/rig/machine/doctor.h"

#include "host/rig/machine/checks.h"
#include "tests/host/rig/machine/fake_machine.h"
#include "tests/host/rig/machine/spoiled_machines.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <map>
#include <set>

namespace vitreo::machine {
namespace VITREO_TEST_FILE {

std::string told(const Findings& findings) { return to_text(findings, 200, false); }

/// The worst state of each check.
std::map<std::string, State> states(const Findings& findings) {
  std::map<std::string, State> worst;
  for (const Finding& finding : findings) {
    const auto [at, first] = worst.try_emplace(finding.check, finding.state);
    if (!first) at->second = std::max(at->second, finding.state);
  }
  return worst;
}

/// Of the check's findings that are in this state.
std::string commands(const Findings& findings, const std::string& check, State state) {
  std::string text;
  for (const Finding& finding : findings)
    if (finding.check == check && finding.state == state)
      for (const std::string& line : finding.mend) text += line + "\n";
  return text;
}

// ---------------------------------------------------------------- what a good machine gives

TEST(Doctor, FindsNothingToMendOnAGoodMachine) {
  const FakeMachine fake;
  const Findings alone = examine(fake.machine(), wanted_without_rig());
  EXPECT_EQ(count(alone, State::good), alone.size()) << told(alone);
  // Whether a camera on the network answers is not known without asking it.
  const Findings rig = examine(fake.machine(), wanted_for_laboratory());
  EXPECT_EQ(count(rig, State::good), rig.size() - 1) << told(rig);
  EXPECT_NE(told(rig).find("not asked, since nothing is sent: top_camera;"), std::string::npos);
  EXPECT_NE(told(rig).find("here: coils, lens_mover, stage and side_camera"), std::string::npos);
}

TEST(Doctor, SaysALineForEachCheck) {
  const FakeMachine fake;
  std::set<std::string> said;
  for (const auto& [check, state] : states(examine(fake.machine(), wanted_for_laboratory())))
    said.insert(check);
  const auto all = check_names();
  EXPECT_EQ(said, std::set<std::string>(all.begin(), all.end()));
  // Without a rig there are no instruments that could be missing.
  EXPECT_EQ(states(examine(fake.machine(), wanted_without_rig())).size(), all.size() - 1);
}

TEST(Doctor, LooksOnlyAtWhatTheRigNeeds) {
  const FakeMachine fake;
  Wanted wanted = wanted_without_rig();
  wanted.rig = RigNeeds{"simulated", {}};
  const auto nothing_real = states(examine(fake.machine(), wanted));
  EXPECT_EQ(nothing_real.size(), 3u) << "cpu, clock, disk";
  wanted.rig = RigNeeds{"bench", {{"stage", "zaber", {"serial", "/dev/ttyUSB0"}}}};
  const auto stage_alone = states(examine(fake.machine(), wanted));
  EXPECT_TRUE(stage_alone.contains("modem_manager"));
  for (const char* const other : {"network", "socket_buffers", "usb_buffers", "priority"})
    EXPECT_FALSE(stage_alone.contains(other)) << other;
  wanted.rig = RigNeeds{"coils", {{"coils", "usb3103", {"hid", "09db:009c"}}}};
  const auto coils_alone = states(examine(fake.machine(), wanted));
  EXPECT_TRUE(coils_alone.contains("priority"));
  for (const char* const other : {"network", "modem_manager", "brltty"})
    EXPECT_FALSE(coils_alone.contains(other)) << other;
  // An emulated rig's loopback has no interface to look at, but sockets.
  wanted.rig = RigNeeds{"loop", {{"top_camera", "genicam", {"genicam", "127.0.0.1"}, 1, 1400, 1}}};
  EXPECT_EQ(states(examine(fake.machine(), wanted)).at("network"), State::good);
}

// A Metrolab probe by its numbers or its kernel node, a game pad by its node; a keyboard is none.
TEST(Doctor, KnowsUsbtmcInstrumentsAndGamePads) {
  FakeMachine fake;
  fake.plug({"1-6", "1bfa", "0498", "0000803", "Metrolab", "THM1176", "fe0301"});
  fake.give_node("1-6", "usbmisc", "usbtmc0", "180:176");
  fake.plug({"1-7", "045e", "028e", "", "Microsoft", "Pad", "030000"});
  fake.give_node("1-7", "input", "event5", "13:69");
  fake.udev("13:69", "E:ID_INPUT_JOYSTICK=1\nG:uaccess\n");
  fake.plug({"1-8", "046d", "c31c", "", "Logitech", "Keyboard", "030101"});
  fake.give_node("1-8", "input", "event6", "13:70");
  fake.udev("13:70", "E:ID_INPUT_KEYBOARD=1\n");
  fake.node("/dev/input/event6", "root", 0600);
  const Findings alone = examine(fake.machine(), wanted_without_rig());
  EXPECT_EQ(count(alone, State::good), alone.size()) << told(alone);
  EXPECT_NE(told(alone).find("/dev/input/event5"), std::string::npos) << told(alone);
  EXPECT_EQ(told(alone).find("event6"), std::string::npos) << told(alone);
  Wanted wanted = wanted_without_rig();
  for (const char* const place : {"1bfa:0498", "/dev/usbtmc0"}) {
    wanted.rig = RigNeeds{"probe",
                          {{"field_probe", "thm1176", {"usbtmc", place}},
                           {"joystick", "game_pad", {"evdev", "/dev/input/event5"}}}};
    EXPECT_NE(told(examine(fake.machine(), wanted)).find("here: field_probe and joystick"),
              std::string::npos)
        << told(examine(fake.machine(), wanted));
    fake.node("/dev/bus/usb/001/007", "root", 0600);
    const Findings closed = examine(fake.machine(), wanted);
    EXPECT_EQ(states(closed).at("permissions"), State::fault) << told(closed);
    EXPECT_NE(commands(closed, "permissions", State::fault).find(kRules), std::string::npos);
    fake.node("/dev/bus/usb/001/007", "plugdev");
  }
  fake.unplug("1-6");
  fake.remove("/dev/usbtmc0");
  EXPECT_NE(told(examine(fake.machine(), wanted)).find("/dev/usbtmc0 is not there"),
            std::string::npos)
      << told(examine(fake.machine(), wanted));
}

// ---------------------------------------------------------------- one thing is wrong

/// What else turns with it, since it is the same fact: a node that the group would have opened.
bool follows(const std::string& spoiled, const std::string& other) {
  static const std::multimap<std::string, std::string> kSame{{"groups", "permissions"},
                                                             {"instruments", "brltty"}};
  const auto [from, to] = kSame.equal_range(spoiled);
  return std::any_of(from, to, [&other](const auto& pair) { return pair.second == other; });
}

void expect_found(const Spoiled& spoiled, const Wanted& wanted) {
  FakeMachine fake;
  spoiled.spoil(fake);
  const Findings findings = examine(fake.machine(), wanted);
  const auto found = states(findings);
  ASSERT_TRUE(found.contains(spoiled.check)) << spoiled.name;
  EXPECT_STREQ(to_string(found.at(spoiled.check)), to_string(spoiled.state)) << spoiled.name << "\n"
                                                                             << told(findings);
  EXPECT_NE(told(findings).find(spoiled.found), std::string::npos)
      << spoiled.name << ": " << spoiled.found << "\n"
      << told(findings);
  const std::string mend = commands(findings, spoiled.check, spoiled.state);
  EXPECT_TRUE(spoiled.mend.empty() ? mend.empty() : mend.find(spoiled.mend) != std::string::npos)
      << spoiled.name << "\n"
      << mend;
  // The camera on the network is never asked.
  for (const auto& [check, state] : found)
    EXPECT_TRUE(state == State::good || check == spoiled.check || follows(spoiled.check, check) ||
                (check == "instruments" && state == State::unknown))
        << spoiled.name << " also turned " << check << "\n"
        << told(findings);
}

TEST(Doctor, TellsWhoMayNotOpenWhatAndWhoElseTakesIt) {
  for (const Spoiled& one : access_and_rivals()) expect_found(one, wanted_for_laboratory());
}
TEST(Doctor, TellsWhatIsWrongWithUsbAndTheNetwork) {
  for (const Spoiled& one : usb_and_network()) expect_found(one, wanted_for_laboratory());
}
TEST(Doctor, TellsWhichInstrumentIsMissing) {
  for (const Spoiled& one : instruments()) expect_found(one, wanted_for_laboratory());
}
TEST(Doctor, TellsWhatIsWrongWithTheComputer) {
  for (const Spoiled& one : computer()) expect_found(one, wanted_for_laboratory());
}

TEST(Doctor, HasASpoiledMachineForEachCheck) {
  std::set<std::string> spoiled{"usb_buffers"};  // below
  for (const auto& all : {access_and_rivals(), usb_and_network(), instruments(), computer()})
    for (const Spoiled& one : all)
      if (one.state != State::unknown) spoiled.insert(one.check);
  const auto all = check_names();
  EXPECT_EQ(spoiled, std::set<std::string>(all.begin(), all.end()));
}

// A USB camera is no part of the laboratory's rig above, whose camera is on the network.
TEST(Doctor, TellsThatAUsb3CameraIsOnAUsb2Connection) {
  Wanted wanted = wanted_without_rig();
  wanted.rig = RigNeeds{
      "microscope",
      {{"top_camera", "genicam", {"genicam", "Basler-acA1300-60gm-21731234"}, 1, 1400, 4 << 20}}};
  const std::string camera = "/sys/devices/pci0000:00/0000:00:14.0/usb1/1-4/";
  expect_found({"USB 2",
                [&](FakeMachine& m) {
                  m.write(camera + "speed", "480\n");
                  m.write(camera + "version", " 2.10\n");
                },
                "usb_speed", State::fault, "480 Mbit/s, a USB3 Vision camera wants 5 Gbit/s", ""},
               wanted);
  expect_found(
      {"16 MB",
       [](FakeMachine& m) { m.write("/sys/module/usbcore/parameters/usbfs_memory_mb", "16\n"); },
       "usb_buffers", State::warning, "16 MB", "systemd-tmpfiles --create"},
      wanted);
  expect_found({"not told",
                [](FakeMachine& m) { m.remove("/sys/module/usbcore/parameters/usbfs_memory_mb"); },
                "usb_buffers", State::unknown, "cannot be read", ""},
               wanted);
}

// ---------------------------------------------------------------- without a rig

TEST(Doctor, SaysWithoutARigWhatItCannotKnow) {
  const std::vector<Spoiled> all{
      {"small buffers", [](FakeMachine& m) { m.write("/proc/sys/net/core/rmem_max", "212992\n"); },
       "socket_buffers", State::warning, "212992", "sysctl --system"},
      {"no jumbo frames", [](FakeMachine& m) { m.write("/sys/class/net/enp3s0/mtu", "1500\n"); },
       "network", State::unknown, "enp3s0 (MTU 1500, 1 Gbit/s)", ""},
      {"an instrument that looks like a modem",
       [](FakeMachine& m) {
         m.process(650, "ModemManager");
         m.plug({"1-7", "1d50", "6018", "7", "Maker", "Teslameter", "020201"});
         m.give_node("1-7", "tty", "ttyACM0", "166:0");
         m.udev("166:0", "G:uaccess\n");
         m.udev("189:8", "G:uaccess\n");
       },
       "modem_manager", State::fault, "probes /dev/ttyACM0 (Maker Teslameter)",
       R"(ATTRS{idVendor}=="1d50", ATTRS{idProduct}=="6018", ENV{ID_MM_DEVICE_IGNORE}="1")"},
      {"brltty would take what is not plugged in yet",
       [](FakeMachine& m) {
         m.unplug("1-3");
         m.remove("/sys/class/tty/ttyUSB0");
         m.write("/etc/udev/rules.d/85-brltty.rules",
                 "ENV{PRODUCT}==\"1a86/7523/*\", "
                 "ENV{BRLTTY_BRAILLE_DRIVER}=\"bm\"\n");
       },
       "brltty", State::warning, "any USB Serial", "85-brltty.rules"},
      {"brltty has taken the adapter",
       [](FakeMachine& m) {
         m.process(651, "brltty");
         m.remove("/sys/class/tty/ttyUSB0");
         m.remove("/dev/ttyUSB0");
       },
       "brltty", State::fault, "no serial port, brltty has taken it", ""},
  };
  for (const Spoiled& one : all) expect_found(one, wanted_without_rig());
}

TEST(Doctor, IsContentWithAnAccessListOfTheSeat) {
  const FakeMachine fake;
  fake.user_in("");
  for (const char* const node : {"/dev/hidraw0", "/dev/ttyUSB0", "/dev/video0",
                                 "/dev/bus/usb/001/003", "/dev/bus/usb/001/005"})
    chmod(fake.at(node).c_str(), 0666);  // stands for the list, which not every file system keeps
  const auto found = states(examine(fake.machine(), wanted_without_rig()));
  EXPECT_EQ(found.at("groups"), State::good);
  EXPECT_EQ(found.at("permissions"), State::good);
}

TEST(Doctor, WarnsOfGroupsBeforeAnythingIsPluggedIn) {
  const FakeMachine fake;
  fake.user_in("");
  fake.remove("/sys/bus/usb/devices");
  fake.remove("/sys/class/tty");
  fake.remove("/sys/class/video4linux");
  const Findings findings = examine(fake.machine(), wanted_without_rig());
  EXPECT_EQ(states(findings).at("groups"), State::warning);
  EXPECT_NE(commands(findings, "groups", State::warning).find("dialout,plugdev"),
            std::string::npos);
  EXPECT_EQ(states(findings).at("permissions"), State::good);
}

TEST(Doctor, ClaimsNothingOfOthersWhenItIsRoot) {
  const FakeMachine fake;
  fake.user_as_root();
  const auto found = states(examine(fake.machine(), wanted_for_laboratory()));
  for (const char* const check : {"groups", "permissions", "priority"})
    EXPECT_EQ(found.at(check), State::unknown) << check;
}

TEST(Doctor, ClaimsNothingOfAMachineThatDoesNotTell) {
  const TemporaryFolder empty;
  const Machine silent(empty.path(), {});
  for (const auto& [check, state] : states(examine(silent, wanted_for_laboratory())))
    EXPECT_NE(state, State::good) << check;
}

// ---------------------------------------------------------------- brltty's rules

TEST(Doctor, ReadsBrlttysRulesAsUdevDoes) {
  const auto brltty = [](const std::string& rules) {
    const FakeMachine fake;
    fake.write("/usr/lib/udev/rules.d/85-brltty.rules", rules);
    return states(examine(fake.machine(), wanted_without_rig())).at("brltty");
  };
  EXPECT_EQ(brltty("# ENV{PRODUCT}==\"403/6001/*\"\n"), State::good) << "a comment";
  EXPECT_EQ(brltty("ENV{PRODUCT}==\"403/6001/*\", ATTRS{manufacturer}==\"Hedo\", GOTO=\"run\"\n"),
            State::good)
      << "another maker's";
  EXPECT_EQ(brltty("ENV{PRODUCT}==\"403/6001/*\", ATTRS{idVendor}==\"1a40\", GOTO=\"run\"\n"),
            State::good)
      << "behind a hub that is not there";
  EXPECT_EQ(brltty("ENV{PRODUCT}==\"403/6001/*\", ATTRS{idVendor}==\"1d6b\", GOTO=\"run\"\n"),
            State::fault)
      << "behind the hub that is there";
  EXPECT_EQ(brltty("ENV{PRODUCT}==\"403/600?/*\", \\\n GOTO=\"run\"\n"), State::fault)
      << "a pattern, in two lines";
  EXPECT_EQ(brltty("ENV{PRODUCT}==\"10c4/ea60/*\", GOTO=\"run\"\n"), State::good)
      << "an adapter that is not here";
  EXPECT_EQ(brltty("SUBSYSTEM==\"usb\", GOTO=\"run\"\n"), State::good) << "names no device";
}

TEST(Doctor, ARuleFileOfTheAdministratorHidesThePackages) {
  const FakeMachine fake;
  fake.write("/usr/lib/udev/rules.d/85-brltty.rules",
             "ENV{PRODUCT}==\"403/6001/*\", GOTO=\"run\"\n");
  fake.link("/etc/udev/rules.d/85-brltty.rules", "/dev/null");
  EXPECT_EQ(states(examine(fake.machine(), wanted_without_rig())).at("brltty"), State::good);
}

// ---------------------------------------------------------------- sleep

TEST(Doctor, ReadsSystemdsSettingsInTheirOrder) {
  const auto sleep = [](const std::function<void(const FakeMachine&)>& set) {
    const FakeMachine fake;
    fake.remove("/etc/systemd/sleep.conf.d");
    set(fake);
    return states(examine(fake.machine(), wanted_without_rig())).at("sleep");
  };
  EXPECT_EQ(sleep([](const FakeMachine&) {}), State::fault) << "the lid, by default";
  EXPECT_EQ(sleep([](const FakeMachine& m) {
              m.write("/etc/systemd/logind.conf",
                      "[Login]\n#HandleLidSwitch=suspend\n"
                      "HandleLidSwitch=ignore\n");
            }),
            State::good);
  EXPECT_EQ(sleep([](const FakeMachine& m) {
              m.write("/etc/systemd/logind.conf", "HandleLidSwitch=ignore\n");
              m.write("/usr/lib/systemd/logind.conf.d/90-laptop.conf", "HandleLidSwitch=suspend\n");
            }),
            State::fault)
      << "a drop-in comes after the main file";
  EXPECT_EQ(sleep([](const FakeMachine& m) {
              m.write("/usr/lib/systemd/sleep.conf.d/50-a.conf", "AllowSuspend=yes\n");
              m.write("/run/systemd/sleep.conf.d/50-a.conf", "AllowSuspend=no\n");
            }),
            State::good)
      << "of one name, /run before /usr/lib";
  EXPECT_EQ(sleep([](const FakeMachine& m) {
              m.write("/etc/systemd/logind.conf",
                      "HandleLidSwitch=ignore\n"
                      "HandleLidSwitchExternalPower=hibernate\n");
            }),
            State::fault)
      << "on the mains";
  EXPECT_EQ(sleep([](const FakeMachine& m) {
              m.link("/etc/systemd/system/suspend.target", "/dev/null");
            }),
            State::good);
  EXPECT_EQ(sleep([](const FakeMachine& m) {
              m.write("/sys/class/input/input1/capabilities/sw", "0\n");
            }),
            State::good)
      << "a machine without a lid";
}

TEST(Doctor, NamesWhoHoldsSleepOffAtPresent) {
  const FakeMachine fake;
  fake.remove("/etc/systemd/sleep.conf.d");
  fake.write("/run/systemd/inhibit/4",
             "WHAT=sleep:idle\nWHO=presentation\nWHY=talk\nMODE=block\nUID=1000\n");
  fake.write("/run/systemd/inhibit/5", "WHAT=sleep\nWHO=NetworkManager\nMODE=delay\n");
  const Findings findings = examine(fake.machine(), wanted_without_rig());
  EXPECT_EQ(states(findings).at("sleep"), State::fault) << "it may end before the run does";
  EXPECT_NE(told(findings).find("held off at present by presentation"), std::string::npos);
  EXPECT_EQ(told(findings).find("by presentation and NetworkManager"), std::string::npos)
      << "which only delays it";
}

// ---------------------------------------------------------------- the real machine

TEST(Doctor, EndsOnThisMachineAndSaysALineForEachCheck) {
  const Machine here;
  for (const Wanted& wanted : {wanted_without_rig(), wanted_for_laboratory()}) {
    const Findings findings = examine(here, wanted);
    const auto found = states(findings);
    for (const std::string& check : check_names())
      EXPECT_EQ(found.contains(check), wanted.rig || check != "instruments") << check;
    for (const Finding& finding : findings) EXPECT_FALSE(finding.found.empty()) << finding.check;
  }
}

TEST(Doctor, ClaimsOfThisMachineOnlyWhatItCouldSee) {
  const Machine here;
  const auto found = states(examine(here, wanted_without_rig()));
  const auto user = user_of(here);
  if (!user || user->opens_everything) {
    EXPECT_EQ(found.at("permissions") == State::fault, false);
    EXPECT_EQ(found.at("groups"), State::unknown);
  }
  const std::map<std::string, std::string> sources{
      {"cpu_speed", "/sys/devices/system/cpu/cpufreq/policy0"},
      {"sleep", "/sys/power/state"},
      {"socket_buffers", "/proc/sys/net/core/rmem_max"}};
  for (const auto& [check, file] : sources)
    EXPECT_TRUE(here.has(file) || found.at(check) == State::unknown) << check;
}

// ---------------------------------------------------------------- what is printed

TEST(Doctor, PrintsTheWorstLastAndKeepsCommandsWhole) {
  const Findings findings{
      {"disk", State::fault, "full", {"du -xh --max-depth=1 / | sort -h | tail"}},
      {"usb_speed", State::good, "no instrument is plugged in"},
      {"usb_power", State::good, "no instrument is plugged in"},
      {"modem_manager", State::warning, "one two three four five six seven eight nine ten"}};
  EXPECT_EQ(to_text(findings, 60, false),
            "good     USB speed, USB power: no instrument is plugged in\n"
            "\n"
            "warning  ModemManager    one two three four five six seven\n"
            "                         eight nine ten\n"
            "\n"
            "FAULT    disk            full\n"
            "         du -xh --max-depth=1 / | sort -h | tail\n"
            "\n"
            "1 fault, 1 warning, 0 unknown, 2 good\n");
}

TEST(Doctor, PrintsTheSameCommandsOnce) {
  const Findings findings{{"groups", State::warning, "a", {"one", "two"}},
                          {"disk", State::fault, "b", {"one", "two"}},
                          {"clock", State::fault, "c", {"one"}}};
  EXPECT_EQ(to_text(findings, 60, false),
            "warning  groups          a\n"
            "         one\n"
            "         two\n"
            "\n"
            "FAULT    disk            b\n"
            "         # the commands of groups, above\n"
            "FAULT    clock           c\n"
            "         one\n"
            "\n"
            "2 faults, 1 warning, 0 unknown, 0 good\n");
}

TEST(Doctor, AnAdapterThatIsNoneOfTheRigsConcernsItOnlyWhileOneIsMissing) {
  const FakeMachine fake;
  fake.plug({"1-6", "1a86", "7523", "", "", "USB Serial"});  // without a port
  EXPECT_EQ(states(examine(fake.machine(), wanted_without_rig())).at("brltty"), State::fault);
  EXPECT_EQ(states(examine(fake.machine(), wanted_for_laboratory())).at("brltty"), State::good);
  fake.remove("/dev/ttyUSB0");
  EXPECT_EQ(states(examine(fake.machine(), wanted_for_laboratory())).at("brltty"), State::fault);
}

TEST(Doctor, ADevicesNameDoesNotSteerTheTerminal) {
  const FakeMachine fake;
  fake.plug({"1-8", "1a86", "7523", "", "QinHeng\x1b[2J", "CH340"});
  EXPECT_EQ(told(examine(fake.machine(), wanted_without_rig())).find('\x1b'), std::string::npos);
}

TEST(Doctor, TellsMissingInstrumentsFromOtherFaults) {
  const Finding gone{"instruments", State::fault, "gone", {}, true};
  const Finding full{"disk", State::fault, "full"};
  const Finding fine{"clock", State::good, "kept"};
  EXPECT_TRUE(only_missing({gone, fine, gone}));
  EXPECT_FALSE(only_missing({gone, full}));
  EXPECT_FALSE(only_missing({fine}));
}

TEST(Doctor, QuotesWordsForTheShell) {
  EXPECT_EQ(shell_word("/dev/ttyUSB0"), "/dev/ttyUSB0");
  EXPECT_EQ(shell_word("my runs"), "'my runs'");
  EXPECT_EQ(shell_word("it's"), "'it'\\''s'");
  EXPECT_EQ(shell_word(""), "''");
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::machine
