// Can an output stay on? The program holds a current or a light on a real node and is killed,
// frozen, starved; so is its guardian; the cable goes; a second program comes.
// SPDX-License-Identifier: Apache-2.0
#include "tests/kernel/guest.h"

#include <gtest/gtest.h>

#include <csignal>
#include <cstdlib>
#include <fcntl.h>
#include <linux/usbdevice_fs.h>
#include <sys/ioctl.h>
#include <sys/wait.h>
#include <thread>
#include <unistd.h>
#include <utility>

namespace vitreo::kernel_guest {
namespace {

namespace fs = std::filesystem;
const fs::path kGroups = "/sys/fs/cgroup";

/// Rows that both amplifiers have.
class Rescue : public ::testing::Test {
 protected:
  static void TearDownTestSuite() { amplifier.reset(); }
  void SetUp() override {
    wait_for_node(amplifier->node());  // a new one after a pulled cable
    amplifier->instrument().order({{"power_cycle", true}});
  }
  void energize(const std::function<void()>& prepare = {}) {
    host = std::make_unique<Host>(*amplifier, prepare);
    host->energize();
    ASSERT_GT(host->guardian(), 0);
  }
  /// ms until the outputs are at zero, for good; fails where they stay on.
  double zero_within(Steady::duration patience) {
    const auto zero = time_until(patience, [&] { return amplifier->at_zero(); });
    EXPECT_TRUE(zero) << host->said();
    EXPECT_FALSE(time_until(100ms, [&] { return !amplifier->at_zero(); })) << "energized again";
    return zero ? zero->count() : -1;
  }
  bool said_within(Steady::duration patience, const std::string& what) {
    return time_until(patience, [&] { return host->said().find(what) != std::string::npos; })
        .has_value();
  }
  /// For the rows that nothing but a line of the amplifier's own can save: what is, and that the
  /// next opening ends it, as docs/instruments.md says.
  void tell_and_open_anew(const char* what) {
    std::this_thread::sleep_for(1s);
    const double left = amplifier->output();
    row("%s: %s 1 s later (%.2f %s)", what, left > 2e-3 ? "STAYS ON" : "at zero", left, unit());
    const Ended ended = run({kProgram, "devices", "--rig", host->folder() / "rig.lua"});
    EXPECT_TRUE(amplifier->at_zero()) << "the next opening leaves it on: " << ended.said;
  }
  /// Whether the host lives, and what flows. In this order: one that ends in between has zeroed it.
  std::pair<bool, double> host_and_output() {
    const bool lives = host->lives();
    return {lives, amplifier->output()};
  }
  virtual const char* unit() const { return "V"; }

  void host_killed();
  void host_frozen();
  void guardian_killed();
  void terminal_hung_up();
  void out_of_memory();
  void cable_out_and_in();
  void second_host();
  void old_guardian();
  void both_killed();
  void control_group_killed();
  void device_reset();
  void frozen_as_for_sleep();

  static std::unique_ptr<Amplifier> amplifier;  // of the whole suite
  std::unique_ptr<Host> host;
};
std::unique_ptr<Amplifier> Rescue::amplifier;

void Rescue::host_killed() {
  energize();
  ::kill(host->process(), SIGKILL);
  row("host killed: at zero after %.0f ms", zero_within(2s));
  EXPECT_TRUE(said_within(2s, "is at zero")) << host->said();
}

void Rescue::host_frozen() {
  energize();
  ::kill(host->process(), SIGSTOP);
  row("host frozen: at zero after %.0f ms", zero_within(3s));
  EXPECT_TRUE(said_within(2s, "is at zero")) << host->said();
  ::kill(host->process(), SIGCONT);
  zero_within(500ms);
  EXPECT_EQ(host->code().value_or(0), 128 + SIGKILL);
}

void Rescue::guardian_killed() {
  energize();
  ::kill(host->guardian(), SIGKILL);
  row("guardian killed: the host puts the outputs to zero after %.0f ms", zero_within(3s));
  EXPECT_TRUE(time_until(20s, [&] { return !host->lives(); })) << host->said();
  EXPECT_EQ(host->code().value_or(-1), 4) << host->said();
  EXPECT_NE(host->said().find("guards the outputs is gone"), std::string::npos) << host->said();
}

/// The terminal's end, as when its window is closed or the network to it is gone.
void Rescue::terminal_hung_up() {
  const int terminal = ::posix_openpt(O_RDWR | O_NOCTTY | O_CLOEXEC);
  ASSERT_TRUE(terminal >= 0 && ::grantpt(terminal) == 0 && ::unlockpt(terminal) == 0);
  const std::string name = ::ptsname(terminal);
  energize([name] {
    ::setsid();
    const int own = ::open(name.c_str(), O_RDWR);  // becomes the session's terminal
    ::dup2(own, 0);
  });
  ::close(terminal);
  row("terminal hung up: at zero after %.0f ms", zero_within(5s));
  EXPECT_TRUE(time_until(20s, [&] { return !host->lives(); })) << host->said();
}

/// A memory control group that is smaller than what is in it: the kernel kills one of it.
void Rescue::out_of_memory() {
  const fs::path group = kGroups / "small";
  write_text(kGroups / "cgroup.subtree_control", "+memory");
  fs::create_directory(group);
  energize([&] { write_text(group / "cgroup.procs", "0"); });
  const pid_t guardian = host->guardian();
  write_text(group / "memory.max", "2M");
  const auto began = Steady::now();
  const double zero = zero_within(10s);
  const std::string events = text_of(group / "memory.events");
  EXPECT_EQ(events.find("oom_kill 0\n"), std::string::npos) << events;
  EXPECT_TRUE(time_until(5s, [&] { return !host->lives(); }));
  const double dead = Milliseconds(Steady::now() - began).count();
  EXPECT_TRUE(said_within(2s, "is at zero")) << host->said();
  row("out of memory: at zero after %.0f ms; the host has ended after %.0f ms", zero, dead);
  ::kill(guardian, SIGKILL);
  host.reset();
  time_until(2s, [&] { return ::rmdir(group.c_str()) == 0; });
}

/// Nothing reaches it while the cable is out; what is on stays on, and goes when the cable is back.
void Rescue::cable_out_and_in() {
  energize();
  amplifier->instrument().unplug();
  const auto gone = time_until(20s, [&] { return !host->lives(); });
  ASSERT_TRUE(gone) << host->said();
  EXPECT_NE(host->code().value_or(0), 0) << host->said();
  const double out = amplifier->output();
  amplifier->instrument().plug();
  row("cable out: the run ends with code %d after %.0f ms, %.2f %s stay; at zero %.0f ms after the "
      "cable is in",
      host->code().value_or(-1), gone->count(), out, unit(), zero_within(10s));
}

// As the operator: root may open what TIOCEXCL has closed.
void Rescue::second_host() {
  energize([] { become(kOperator); });
  const Ended second = run({kProgram, "devices", "--rig", host->folder() / "rig.lua"}, kOperator);
  EXPECT_NE(second.code, 0);
  EXPECT_NE(second.said.find("another program has it open"), std::string::npos) << second.said;
  EXPECT_FALSE(time_until(300ms, [&] { return !amplifier->energized(); })) << "touched";
  EXPECT_TRUE(host->lives()) << host->said();
  row("second host: refused with code %d, the first one's output stays", second.code);
}

/// Its host dies while it is stopped; by the time it goes on, another host has the device.
void Rescue::old_guardian() {
  energize([] { become(kOperator); });
  const pid_t old = host->guardian();
  ::kill(old, SIGSTOP);
  ::kill(host->process(), SIGKILL);
  Host next(*amplifier, [] { become(kOperator); });
  ASSERT_TRUE(time_until(20s, [&] { return amplifier->at_zero(); })) << next.said();
  next.energize();
  ::kill(old, SIGCONT);
  EXPECT_TRUE(said_within(3s, "has another owner by now")) << host->said();
  EXPECT_FALSE(time_until(500ms, [&] { return !amplifier->energized(); })) << "zeroed";
  EXPECT_TRUE(next.lives()) << next.said();
  row("old guardian: leaves the device to its new host");
}

/// The host stands from the first signal on: on one processor it would else see its guardian's end,
/// and zero the outputs itself, before the second kill.
void Rescue::both_killed() {
  energize();
  ::kill(host->process(), SIGSTOP);
  ::kill(host->guardian(), SIGKILL);
  ::kill(host->process(), SIGKILL);
  tell_and_open_anew("guardian and host killed at once");
}

// The guardian is in a group of its own.
void Rescue::control_group_killed() {
  const fs::path group = kGroups / "whole";
  fs::create_directory(group);
  energize([&] { write_text(group / "cgroup.procs", "0"); });
  write_text(group / "cgroup.kill", "1");
  row("control group killed: at zero after %.0f ms", zero_within(2s));
  host.reset();
  time_until(2s, [&] { return ::rmdir(group.c_str()) == 0; });
}

/// What a hub in trouble does: the device is configured anew, its outputs are not touched.
void Rescue::device_reset() {
  energize();
  int buses = 0;
  for (const auto& device : fs::recursive_directory_iterator("/dev/bus/usb")) {
    if (fs::is_directory(device) || device.path().filename() == "001") continue;
    const int node = ::open(device.path().c_str(), O_WRONLY | O_CLOEXEC);
    buses += ::ioctl(node, USBDEVFS_RESET, 0) == 0 ? 1 : 0;
    ::close(node);
  }
  ASSERT_GT(buses, 0);
  std::this_thread::sleep_for(1s);
  const auto [lives, left] = host_and_output();
  EXPECT_TRUE(lives || left < 2e-3) << "on, and no host: " << host->said();
  row("device reset: 1 s later the run %s, %.2f %s", lives ? "goes on" : "has ended", left, unit());
}

/// Freezes user space as sleep does, for some seconds: guardian and host alike.
void Rescue::frozen_as_for_sleep() {
  energize();
  write_text("/sys/module/suspend/parameters/pm_test_delay", "2");
  write_text("/sys/power/pm_test", "devices");
  const auto began = Steady::now();
  write_text("/sys/power/state", "freeze");
  const double away = Milliseconds(Steady::now() - began).count();
  write_text("/sys/power/pm_test", "none");
  std::this_thread::sleep_for(1s);
  const auto [lives, left] = host_and_output();
  EXPECT_GT(away, 1500) << "it did not freeze";
  EXPECT_TRUE(lives || left < 2e-3) << "on, and no host: " << host->said();
  row("all of user space frozen for %.0f ms: 1 s later the run %s, %.2f %s", away,
      lives ? "goes on" : "has ended", left, unit());
}

class RescueUsb3103Guest : public Rescue {
 protected:
  static void SetUpTestSuite() {
    load_gadgets();
    load({"usb_f_hid", "usbhid", "hid-generic"});
    amplifier = usb3103_gadget();
  }
};
class RescueBopGuest : public Rescue {
 protected:
  static void SetUpTestSuite() {
    load_gadgets();
    load({"usb_f_acm", "cdc-acm"});
    amplifier = bop_gadget();
  }
  const char* unit() const override { return "A"; }
};

TEST_F(RescueUsb3103Guest, HostKilled) { host_killed(); }
TEST_F(RescueUsb3103Guest, HostFrozen) { host_frozen(); }
TEST_F(RescueUsb3103Guest, GuardianKilled) { guardian_killed(); }
TEST_F(RescueUsb3103Guest, TerminalHungUp) { terminal_hung_up(); }
TEST_F(RescueUsb3103Guest, OutOfMemory) { out_of_memory(); }
TEST_F(RescueUsb3103Guest, CableOutAndIn) { cable_out_and_in(); }
TEST_F(RescueUsb3103Guest, SecondHost) { second_host(); }
TEST_F(RescueUsb3103Guest, OldGuardian) { old_guardian(); }
TEST_F(RescueUsb3103Guest, GuardianKilledAndTheHostBeforeItNotices) { both_killed(); }
TEST_F(RescueUsb3103Guest, ControlGroupKilled) { control_group_killed(); }
TEST_F(RescueUsb3103Guest, DeviceReset) { device_reset(); }
TEST_F(RescueUsb3103Guest, FrozenAsForSleep) { frozen_as_for_sleep(); }

std::string inhibitors() { return run({"sh", "-c", "cat /run/inhibitor.* 2>/dev/null"}).said; }

// systemd-inhibit is the guest's own, which notes what it was asked for (tests/kernel/).
TEST_F(RescueUsb3103Guest, SleepIsInhibitedAsLongAsTheHostLives) {
  run({"sh", "-c", "rm -f /run/inhibitor.*"});
  energize();
  // A process of its own, which may come to its turn after the current.
  std::string asked;
  time_until(5s, [&] { return (asked = inhibitors()).find("--what=sleep") != std::string::npos; });
  EXPECT_NE(asked.find("--what=sleep"), std::string::npos) << asked;
  EXPECT_NE(asked.find("--mode=block"), std::string::npos) << asked;
  ::kill(host->process(), SIGKILL);
  EXPECT_TRUE(time_until(2s, [] { return inhibitors().empty(); })) << inhibitors();
  row("sleep inhibitor: %s", asked.substr(0, asked.find('\n')).c_str());
  zero_within(2s);
}

TEST_F(RescueBopGuest, HostKilled) { host_killed(); }
TEST_F(RescueBopGuest, HostFrozen) { host_frozen(); }
TEST_F(RescueBopGuest, GuardianKilled) { guardian_killed(); }
TEST_F(RescueBopGuest, TerminalHungUp) { terminal_hung_up(); }
TEST_F(RescueBopGuest, OutOfMemory) { out_of_memory(); }
TEST_F(RescueBopGuest, CableOutAndIn) { cable_out_and_in(); }
TEST_F(RescueBopGuest, SecondHost) { second_host(); }
TEST_F(RescueBopGuest, OldGuardian) { old_guardian(); }
TEST_F(RescueBopGuest, GuardianKilledAndTheHostBeforeItNotices) { both_killed(); }
TEST_F(RescueBopGuest, ControlGroupKilled) { control_group_killed(); }
TEST_F(RescueBopGuest, DeviceReset) { device_reset(); }
TEST_F(RescueBopGuest, FrozenAsForSleep) { frozen_as_for_sleep(); }

class RescueLampGuest : public Rescue {
 protected:
  static void SetUpTestSuite() {
    load_gadgets();
    load({"usb_f_hid", "usbhid", "hid-generic"});
    amplifier = usb3103_gadget("lamp");
  }
};
TEST_F(RescueLampGuest, HostKilled) { host_killed(); }
TEST_F(RescueLampGuest, HostFrozen) { host_frozen(); }
TEST_F(RescueLampGuest, GuardianKilled) { guardian_killed(); }
TEST_F(RescueLampGuest, TerminalHungUp) { terminal_hung_up(); }
TEST_F(RescueLampGuest, OutOfMemory) { out_of_memory(); }
TEST_F(RescueLampGuest, CableOutAndIn) { cable_out_and_in(); }
TEST_F(RescueLampGuest, SecondHost) { second_host(); }
TEST_F(RescueLampGuest, OldGuardian) { old_guardian(); }
TEST_F(RescueLampGuest, GuardianKilledAndTheHostBeforeItNotices) { both_killed(); }
TEST_F(RescueLampGuest, ControlGroupKilled) { control_group_killed(); }
TEST_F(RescueLampGuest, DeviceReset) { device_reset(); }
TEST_F(RescueLampGuest, FrozenAsForSleep) { frozen_as_for_sleep(); }

}  // namespace
}  // namespace vitreo::kernel_guest
