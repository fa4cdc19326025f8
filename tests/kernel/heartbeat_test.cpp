// Rows in which the outputs of a static line stay on, with a heartbeat line: the amplifiers are off
// when the edges end, as the double's one-shot and relay have it. Behind this machine's own
// controller, and outside of the machine for what happens to all of it.
// SPDX-License-Identifier: Apache-2.0
#include "tests/kernel/guest.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <csignal>
#include <thread>

namespace vitreo::kernel_guest {
namespace {

namespace fs = std::filesystem;

/// What the double's history has of the relay, behind a moment of its clock.
struct Relay {
  double last_edge = 0;          ///< s: the last one before it opened
  std::optional<double> opened;  ///< s
  int closed_again = 0;
};

Relay relay_in(const nlohmann::json& history, double since) {
  Relay relay;
  for (const nlohmann::json& line : history) {
    const double at = line[0].get<double>();
    if (line[1] == "port_latch" && (line[2].get<int>() & 1) != 0 && !relay.opened)
      relay.last_edge = at;
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
    began = device().order({{"now", true}}).at("now");
    if (!amplifier->energized()) throw std::runtime_error("not for long: " + host->said());
  }
  Relay relay() { return relay_in(device().order({{"history", true}}).at("history"), began); }
  /// Behind the event: prints when the relay opened; fails where it did not within `bound` ms, or
  /// closed again.
  void expect_off(const char* what, double bound) {
    time_until(3s, [&] { return !device().state("amplifiers").get<bool>(); });
    std::this_thread::sleep_for(1s);
    const Relay seen = relay();
    ASSERT_TRUE(seen.opened) << what << ": the amplifiers stay on; " << host->said();
    const double off = (*seen.opened - began) * 1e3;
    row("%s: amplifiers off after %.0f ms (%.0f ms after the last edge), %.2f V behind them", what,
        off, (*seen.opened - seen.last_edge) * 1e3, volts());
    EXPECT_LT(off, bound) << what;
    EXPECT_EQ(seen.closed_again, 0) << what << ": on again; " << host->said();
    EXPECT_EQ(amplifier->output(), 0);
  }
  double volts() {
    double most = 0;
    for (const nlohmann::json& one : device().state("volts"))
      most = std::max(most, std::abs(one.get<double>()));
    return most;
  }
  Instrument& device() { return amplifier->instrument(); }

  std::unique_ptr<Amplifier> amplifier;
  std::unique_ptr<Host> host;
  double began = 0;  // s of the double's clock: the event
};

class HeartbeatGuest : public Heartbeat {
 protected:
  static constexpr double kGoal = 100;  // ms
  static void SetUpTestSuite() {
    load_gadgets();
    load({"usb_f_hid", "usbhid", "hid-generic"});
  }
  void SetUp() override { amplifier = usb3103_gadget("coils", Beat{}); }
};

TEST_F(HeartbeatGuest, HostKilled) {
  energize();
  ::kill(host->process(), SIGKILL);
  expect_off("host killed", kGoal);
}

TEST_F(HeartbeatGuest, HostFrozen) {
  energize();
  ::kill(host->process(), SIGSTOP);
  expect_off("host frozen", kGoal);
}

TEST_F(HeartbeatGuest, GuardianKilledAndTheHostBeforeItNotices) {
  energize();
  ::kill(host->guardian(), SIGKILL);
  ::kill(host->process(), SIGKILL);
  expect_off("guardian and host killed at once", kGoal);
  EXPECT_GT(volts(), 0.4) << "nothing has zeroed it: the relay alone is judged";
}

TEST_F(HeartbeatGuest, ControlGroupKilled) {
  const fs::path group = "/sys/fs/cgroup/beating";
  fs::create_directory(group);
  energize([&] { write_text(group / "cgroup.procs", "0"); });
  write_text(group / "cgroup.kill", "1");
  expect_off("control group killed", kGoal);
}

TEST_F(HeartbeatGuest, CableOutAndIn) {
  energize();
  device().unplug();
  expect_off("cable out", kGoal);
  device().plug();
  EXPECT_TRUE(time_until(10s, [&] { return volts() < 2e-3; })) << host->said();
  EXPECT_EQ(relay().closed_again, 0) << "cable in: on again; " << host->said();
}

/// Outside of the machine, whose time is then the computer's, with whatever else this one does
/// meanwhile: where it cannot keep the beat, a slower one with a longer pulse is judged.
class HeartbeatOutsideGuest : public Heartbeat {
 protected:
  static constexpr Beat kSlow{10, 0.5, 0.015};
  /// ms: the pulse, and what comes before the last edge.
  double bound() const { return slow ? 800 : 300; }
  static void SetUpTestSuite() {
    load({"xhci-pci", "usbhid", "hid-generic"});
    wait_for_node("/dev/hidraw0");
  }
  void wire() {
    wait_for_node("/dev/hidraw0");
    amplifier = std::make_unique<Voltages>(std::make_unique<Outside>("usb3103"), "coils",
                                           slow ? kSlow : Beat{});
  }
  void energize(const std::function<void()>& prepare = {}) override {
    for (int i = 1;; ++i) try {
        wire();
        Heartbeat::energize(prepare);
        return row("beat of %s", slow ? "10 Hz, pulse of 500 ms" : "50 Hz, pulse of 70 ms");
      } catch (const std::runtime_error&) {
        if (i == 5) throw;
        host.reset();
        slow = i >= 2;
      }
  }
  /// After the machine's absence the run is over: by the host's own trip, or by the guardian where
  /// it sees first that the host has not moved.
  void expect_trip() {
    const auto ended = time_until(40s, [&] { return !host->lives(); });
    ASSERT_TRUE(ended) << "the run goes on: " << host->said();
    const bool own = host->said().find("the heartbeat line") != std::string::npos;
    const bool killed = host->said().find("the host has not moved") != std::string::npos;
    EXPECT_TRUE(own || killed) << host->said();
    EXPECT_NE(host->code().value_or(0), 0) << host->said();
    row("the run has ended with code %d, by %s", *host->code(),
        own ? "the host's own trip" : "the guardian");
    EXPECT_LT(volts(), 2e-3) << host->said();
    EXPECT_EQ(relay().closed_again, 0) << "on again; " << host->said();
  }

  bool slow = false;
};

TEST_F(HeartbeatOutsideGuest, UserSpaceFrozenAsForSleep) {
  write_text("/sys/module/suspend/parameters/pm_test_delay", "2");
  write_text("/sys/power/pm_test", "devices");
  energize();
  const auto asleep = Steady::now();
  write_text("/sys/power/state", "freeze");
  EXPECT_GT(Steady::now() - asleep, 1500ms) << "it did not freeze";
  write_text("/sys/power/pm_test", "none");
  expect_off("all of user space frozen", bound());
  expect_trip();
}

TEST_F(HeartbeatOutsideGuest, Sleep) {
  energize();
  write_text("/sys/class/rtc/rtc0/wakealarm", "+4");
  write_text("/sys/power/state", "mem");
  const double awake = device().order({{"now", true}}).at("now");
  EXPECT_GT(awake - began, 2) << "it did not sleep";
  expect_off("sleep (S3)", bound());
  expect_trip();
  row("asleep for %.1f s", awake - began);
}

/// The last one: run.py judges it.
TEST_F(HeartbeatOutsideGuest, PanicOfTheKernel) {
  energize();
  send_line("LEAVE", std::to_string(began) + " " + std::to_string(bound()));
  write_text("/proc/sysrq-trigger", "c");
  std::this_thread::sleep_for(10s);
  FAIL() << "the kernel goes on";
}

}  // namespace
}  // namespace vitreo::kernel_guest
