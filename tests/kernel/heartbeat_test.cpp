// Rows in which the outputs of a static line stay on, with a heartbeat line: the amplifiers are off
// when the edges end, as the double's one-shot and relay have it. Behind this machine's own
// controller, and outside of the machine for what happens to all of it.
// SPDX-License-Identifier: Apache-2.0
#include "tests/kernel/guest.h"

#include <gtest/gtest.h>

#include <csignal>
#include <limits>
#include <thread>
#include <unistd.h>

namespace vitreo::kernel_guest {
namespace {

namespace fs = std::filesystem;

/// What the double's history has of the relay, behind a moment of its clock.
struct Relay {
  double last_edge = 0;          ///< s: the last one before it opened
  std::optional<double> opened;  ///< s
  int closed_again = 0;
};

Relay relay_in(const nlohmann::json& history, const std::string& edges, double since) {
  Relay relay;
  for (const nlohmann::json& line : history) {
    const double at = line[0].get<double>();
    if (line[1] == edges && (line[2].get<int>() & 1) != 0 && !relay.opened) relay.last_edge = at;
    if (line[1] != "amplifiers" || at < since) continue;
    if (line[2].get<bool>())
      relay.closed_again += relay.opened ? 1 : 0;
    else if (!relay.opened)
      relay.opened = at;
  }
  return relay;
}

class Heartbeat : public ::testing::Test {
 protected:
  /// On, and beating for a while, so that the event meets any phase of the beat.
  virtual void energize(const std::function<void()>& prepare = {}) {
    host = std::make_unique<Host>(*amplifier, prepare);
    host->energize();
    std::this_thread::sleep_for(250ms);
    began = now();
    if (!amplifier->energized()) throw std::runtime_error("not for long: " + host->said());
  }
  Relay relay() {
    return relay_in(line().order({{"history", true}}).at("history"), amplifier->edges(), began);
  }
  /// Behind the event: prints when the relay opened; fails where it did not within `bound` ms, or
  /// closed again.
  void expect_off(const char* what, double bound) { EXPECT_LT(off_after(what), bound) << what; }
  /// ms; infinite where it did not open, which fails, as does one that closed again.
  double off_after(const char* what) {
    time_until(3s, [&] { return !line().state("amplifiers").get<bool>(); });
    std::this_thread::sleep_for(1s);
    const Relay seen = relay();
    EXPECT_TRUE(seen.opened) << what << ": the amplifiers stay on; " << host->said();
    if (!seen.opened) return std::numeric_limits<double>::infinity();
    const double off = (*seen.opened - began) * 1e3;
    row("%s: off after %.0f ms (%.0f ms after the last edge); set to %.2f %s then", what, off,
        (*seen.opened - seen.last_edge) * 1e3, level(), unit());
    EXPECT_EQ(seen.closed_again, 0) << what << ": on again; " << host->said();
    EXPECT_EQ(amplifier->output(), 0);
    return off;
  }
  virtual const char* unit() const { return "V"; }
  double level() { return amplifier->level(); }
  Instrument& line() { return amplifier->line(); }
  double now() { return line().order({{"now", true}}).at("now"); }

  void host_killed();
  void host_frozen();
  void both_killed();
  void control_group_killed();
  void cable_out_and_in(Instrument& device, const char* what, double bound);

  std::unique_ptr<Amplifier> amplifier;
  std::unique_ptr<Host> host;
  double began = 0;  // s of the line's clock: the event
};

constexpr double kGoal = 100;  // ms

void Heartbeat::host_killed() {
  energize();
  ::kill(host->process(), SIGKILL);
  expect_off("host killed", kGoal);
}

void Heartbeat::host_frozen() {
  energize();
  ::kill(host->process(), SIGSTOP);
  expect_off("host frozen", kGoal);
}

/// The host stands from the first signal on: on one processor it would else see its guardian's end,
/// and zero the outputs itself, before the second kill.
void Heartbeat::both_killed() {
  energize();
  ::kill(host->process(), SIGSTOP);
  ::kill(host->guardian(), SIGKILL);
  ::kill(host->process(), SIGKILL);
  expect_off("guardian and host killed at once", kGoal);
  EXPECT_GT(level(), 0.4) << "nothing has zeroed it: the relay alone is judged";
}

void Heartbeat::control_group_killed() {
  const fs::path group = "/sys/fs/cgroup/beating";
  fs::create_directory(group);
  energize([&] { write_text(group / "cgroup.procs", "0"); });
  write_text(group / "cgroup.kill", "1");
  expect_off("control group killed", kGoal);
  host.reset();
  time_until(2s, [&] { return ::rmdir(group.c_str()) == 0; });
}

void Heartbeat::cable_out_and_in(Instrument& device, const char* what, double bound) {
  energize();
  device.unplug();
  expect_off(what, bound);
  device.plug();
  EXPECT_TRUE(time_until(10s, [&] { return level() < 2e-3; })) << host->said();
  EXPECT_EQ(relay().closed_again, 0) << "cable in: on again; " << host->said();
}

/// On a digital line of the interface itself.
class HeartbeatGuest : public Heartbeat {
 protected:
  static void SetUpTestSuite() {
    load_gadgets();
    load({"usb_f_hid", "usbhid", "hid-generic"});
  }
  void SetUp() override { amplifier = usb3103_gadget("coils", Beat{}); }
};

TEST_F(HeartbeatGuest, HostKilled) { host_killed(); }
TEST_F(HeartbeatGuest, HostFrozen) { host_frozen(); }
TEST_F(HeartbeatGuest, GuardianKilledAndTheHostBeforeItNotices) { both_killed(); }
TEST_F(HeartbeatGuest, ControlGroupKilled) { control_group_killed(); }
TEST_F(HeartbeatGuest, CableOutAndIn) {
  cable_out_and_in(amplifier->instrument(), "cable out", kGoal);
}

class HeartbeatLampGuest : public HeartbeatGuest {
 protected:
  void SetUp() override { amplifier = usb3103_gadget("lamp", Beat{}); }
};

TEST_F(HeartbeatLampGuest, HostKilled) { host_killed(); }
TEST_F(HeartbeatLampGuest, HostFrozen) { host_frozen(); }
TEST_F(HeartbeatLampGuest, GuardianKilledAndTheHostBeforeItNotices) { both_killed(); }
TEST_F(HeartbeatLampGuest, ControlGroupKilled) { control_group_killed(); }
TEST_F(HeartbeatLampGuest, CableOutAndIn) {
  cable_out_and_in(amplifier->instrument(), "cable out", kGoal);
}

/// A supply on one serial port, and RTS of an FTDI adapter in another.
class HeartbeatBopGuest : public Heartbeat {
 protected:
  static void SetUpTestSuite() {
    load_gadgets();
    load({"usb_f_acm", "cdc-acm", "vhci-hcd", "ftdi_sio"});
  }
  void SetUp() override { amplifier = bop_gadget(Beat{}); }
  const char* unit() const override { return "A"; }
};

TEST_F(HeartbeatBopGuest, HostKilled) { host_killed(); }
TEST_F(HeartbeatBopGuest, HostFrozen) { host_frozen(); }
TEST_F(HeartbeatBopGuest, GuardianKilledAndTheHostBeforeItNotices) { both_killed(); }
TEST_F(HeartbeatBopGuest, ControlGroupKilled) { control_group_killed(); }
TEST_F(HeartbeatBopGuest, CableOfTheSupplyOutAndIn) {
  cable_out_and_in(amplifier->instrument(), "the supply's cable out", kGoal);
}
TEST_F(HeartbeatBopGuest, CableOfTheLineOutAndIn) {
  cable_out_and_in(amplifier->line(), "the line's cable out", kGoal);
}

/// Outside of the machine, whose time is then the computer's, with whatever else this one does
/// meanwhile: where it cannot keep the beat, or was so late to stand still that the time says
/// nothing, a slower beat with a longer pulse is judged. That the edges end, and stay ended, is
/// judged always.
class HeartbeatOutside : public Heartbeat {
 protected:
  static constexpr Beat kSlow{10, 0.5, 0.015, 0.6};
  /// ms: the pulse, and what comes before the last edge.
  double bound() const { return slow ? 800 : 300; }
  virtual std::unique_ptr<Amplifier> wired(const Beat& beat) = 0;
  void energize(const std::function<void()>& prepare = {}) override {
    for (int i = 1;; ++i) try {
        amplifier = wired(slow ? kSlow : Beat{});
        Heartbeat::energize(prepare);
        return row("beat of %s", slow ? "10 Hz, pulse of 500 ms" : "50 Hz, pulse of 70 ms");
      } catch (const std::runtime_error&) {
        if (i == 5) throw;
        host.reset();
        slow = i >= 2;
      }
  }
  /// After the machine's absence the run is over: by the host's own trip (of the line's lateness,
  /// or of a port that the reset at waking has hung up), or by the guardian where it sees first
  /// that the host has not moved.
  void expect_trip() {
    const auto ended = time_until(40s, [&] { return !host->lives(); });
    ASSERT_TRUE(ended) << "the run goes on: " << host->said();
    const bool own = host->said().find("the heartbeat line") != std::string::npos ||
                     host->said().find("has hung up") != std::string::npos;
    const bool killed = host->said().find("the host has not moved") != std::string::npos;
    EXPECT_TRUE(own || killed) << host->said();
    EXPECT_NE(host->code().value_or(0), 0) << host->said();
    row("the run has ended with code %d, by %s", *host->code(),
        own ? "the host's own trip" : "the guardian");
    EXPECT_TRUE(time_until(10s, [&] { return level() < 2e-3; })) << host->said();
    EXPECT_EQ(relay().closed_again, 0) << "on again; " << host->said();
  }

  /// `away` makes the machine stand still for a while.
  void expect_off_while(const char* what, const std::function<void()>& away) {
    for (;;) {
      energize();
      away();
      const double off = off_after(what);
      expect_trip();
      if (slow || off < bound()) {
        EXPECT_LT(off, bound()) << what;
        return;
      }
      host.reset();
      slow = true;
    }
  }

  void frozen_as_for_sleep();
  void sleep();
  void panic();

  bool slow = false;
};

void HeartbeatOutside::frozen_as_for_sleep() {
  expect_off_while("all of user space frozen", [] {
    write_text("/sys/module/suspend/parameters/pm_test_delay", "2");
    write_text("/sys/power/pm_test", "devices");
    const auto asleep = Steady::now();
    write_text("/sys/power/state", "freeze");
    EXPECT_GT(Steady::now() - asleep, 1500ms) << "it did not freeze";
    write_text("/sys/power/pm_test", "none");
  });
}

void HeartbeatOutside::sleep() {
  expect_off_while("sleep (S3)", [this] {
    write_text("/sys/class/rtc/rtc0/wakealarm", "+4");
    write_text("/sys/power/state", "mem");
    const double awake = now();
    EXPECT_GT(awake - began, 2) << "it did not sleep";
    row("asleep for %.1f s", awake - began);
  });
}

/// The last one: run.py judges it.
void HeartbeatOutside::panic() {
  energize();
  send_line("LEAVE", std::to_string(began) + " " + std::to_string(bound()));
  write_text("/proc/sysrq-trigger", "c");
  std::this_thread::sleep_for(10s);
  FAIL() << "the kernel goes on";
}

class HeartbeatOutsideGuest : public HeartbeatOutside {
 protected:
  static void SetUpTestSuite() { load({"xhci-pci", "usbhid", "hid-generic"}); }
  std::unique_ptr<Amplifier> wired(const Beat& beat) override {
    wait_for_node("/dev/hidraw0");
    return std::make_unique<Voltages>(std::make_unique<Outside>("usb3103"), "coils", beat);
  }
};

TEST_F(HeartbeatOutsideGuest, UserSpaceFrozenAsForSleep) { frozen_as_for_sleep(); }
TEST_F(HeartbeatOutsideGuest, Sleep) { sleep(); }
TEST_F(HeartbeatOutsideGuest, PanicOfTheKernel) { panic(); }

/// A supply and a heartbeat's line, each behind an FTDI adapter.
class HeartbeatBopOutsideGuest : public HeartbeatOutside {
 protected:
  static void SetUpTestSuite() { load({"xhci-pci", "ftdi_sio"}); }
  std::unique_ptr<Amplifier> wired(const Beat& beat) override {
    const std::string supply = adapter_node("BOP"), line = adapter_node("LINE");
    return std::make_unique<Bop>(std::make_unique<Outside>("supply"), supply,
                                 std::make_unique<Outside>("line"), line, beat);
  }
  const char* unit() const override { return "A"; }
};

TEST_F(HeartbeatBopOutsideGuest, UserSpaceFrozenAsForSleep) { frozen_as_for_sleep(); }
TEST_F(HeartbeatBopOutsideGuest, Sleep) { sleep(); }
TEST_F(HeartbeatBopOutsideGuest, PanicOfTheKernel) { panic(); }

}  // namespace
}  // namespace vitreo::kernel_guest
