// Three processes: the program that holds currents, its guardian, and this one with the emulated
// amplifiers. The program is killed, or frozen and later thawed, at random moments: the outputs go
// to zero and stay there. ctest starts this program under umockdev-wrapper; these tests wait for
// real.
// SPDX-License-Identifier: Apache-2.0
#include "devices/links/address.h"
#include "devices/time/error.h"
#include "host/safety/guardian/duty.h"
#include "tests/devices/links/echo_peer.h"
#include "tests/host/safety/guardian/guardian_bench.h"

#include <algorithm>
#include <csignal>
#include <cstdio>
#include <sys/wait.h>
#include <unistd.h>

namespace vitreo {
namespace VITREO_TEST_FILE {

TEST_F(GuardianTest, ZeroesAnAmplifierOnUsbWhenTheHostIsKilled) {
  Usb amplifier;
  trials_of(amplifier, "USB-3103", SIGKILL);
}

TEST_F(GuardianTest, ZeroesAnAmplifierOnUsbWhenTheHostIsFrozenAndThenThawed) {
  Usb amplifier;
  trials_of(amplifier, "USB-3103", SIGSTOP);
}

TEST_F(GuardianTest, ZeroesAnAmplifierOnASerialLineWhenTheHostIsKilled) {
  Kepco amplifier;
  trials_of(amplifier, "BOP", SIGKILL);
}

TEST_F(GuardianTest, ZeroesAnAmplifierOnASerialLineWhenTheHostIsFrozenAndThenThawed) {
  Kepco amplifier;
  trials_of(amplifier, "BOP", SIGSTOP);
}

bool is_refused(const std::function<void()>& open) {
  try {
    open();
  } catch (const DeviceError& error) {
    return error.kind == DeviceErrorKind::refused;
  }
  return false;
}

TEST_F(GuardianTest, FindsAUsbDeviceThatIsTheHostsAloneAsLongAsThatLives) {
  Usb amplifier;
  const auto clock = wall_clock();
  const std::unique_ptr<Host> begun = energize(amplifier);
  ASSERT_NE(begun, nullptr);
  EXPECT_TRUE(
      is_refused([&] { open_hid_link(parse_usb_address("hid", "hid:09db:009c"), *clock); }));
}

TEST_F(GuardianTest, FindsASerialLineThatIsTheHostsAloneAsLongAsThatLives) {
  Kepco amplifier;
  const auto clock = wall_clock();
  const std::unique_ptr<Host> begun = energize(amplifier);
  ASSERT_NE(begun, nullptr);
  EXPECT_TRUE(is_refused([&] { open_byte_link(amplifier.end.address(), {}, *clock); }));
}

TEST_F(GuardianTest, GoesQuietlyWithAHostThatEndsInOrder) {
  Usb amplifier;
  const std::unique_ptr<Host> begun = energize(amplifier);
  ASSERT_NE(begun, nullptr);
  Host& host = *begun;
  host.signal(SIGINT);
  std::optional<int> status;
  ASSERT_TRUE(time_until(20s, [&] { return (status = host.status()).has_value(); })) << log();
  EXPECT_TRUE(WIFEXITED(*status));
  EXPECT_EQ(WEXITSTATUS(*status), 3);
  EXPECT_LT(amplifier.output(), 1e-3);
  EXPECT_FALSE(guardian_says("vitreo guardian: ")) << log();
}

TEST_F(GuardianTest, IsMissedByItsHostWhichThenEndsTheRunAtZero) {
  Usb amplifier;
  const std::unique_ptr<Host> begun = energize(amplifier);
  ASSERT_NE(begun, nullptr);
  Host& host = *begun;
  const pid_t guardian = host.guardian();
  ASSERT_GT(guardian, 0);
  kill(guardian, SIGTERM);  // which it does not obey
  std::this_thread::sleep_for(50ms);
  EXPECT_FALSE(host.status());
  kill(guardian, SIGKILL);
  std::optional<int> status;
  ASSERT_TRUE(time_until(20s, [&] { return (status = host.status()).has_value(); })) << log();
  EXPECT_EQ(WEXITSTATUS(*status), 4) << log();
  EXPECT_LT(amplifier.output(), 1e-3);
  EXPECT_TRUE(guardian_says("the process that guards the outputs is gone")) << log();
}

TEST_F(GuardianTest, DarkensALampWhenTheHostIsKilledAndWhenItIsFrozen) {
  Lamp3103 lamp;
  std::printf("lamp, SIGKILL: dark after %.0f ms\n", trial(lamp, SIGKILL, kHeld));
  std::printf("lamp, SIGSTOP: dark after %.0f ms\n", trial(lamp, SIGSTOP, kHeld));
}

// Before, a run that held a current noticed it at its next set-point only: after a minute here.
void expect_end_at_zero(Host& host, Amplifier& amplifier, const std::function<std::string()>& log) {
  const auto began = Steady::now();
  const auto zero = time_until(20s, [&] { return amplifier.output() < 1e-3; });
  ASSERT_TRUE(zero) << log();
  std::printf("at zero after %.0f ms\n", zero->count());
  std::optional<int> status;
  ASSERT_TRUE(time_until(20s, [&] { return (status = host.status()).has_value(); })) << log();
  EXPECT_LT(Steady::now() - began, 20s) << "the script would have gone on for a minute";
  EXPECT_EQ(WEXITSTATUS(*status), 4) << log();
}

TEST_F(GuardianTest, IsMissedWhileACurrentIsHeld) {
  Usb amplifier;
  const std::unique_ptr<Host> host = energize(amplifier, kHeld);
  ASSERT_NE(host, nullptr);
  host->signal_guardian(SIGKILL);
  expect_end_at_zero(*host, amplifier, [this] { return log(); });
  EXPECT_TRUE(guardian_says("the process that guards the outputs is gone")) << log();
}

TEST_F(GuardianTest, IsMissedWhileALightIsHeld) {
  Lamp3103 lamp;
  const std::unique_ptr<Host> host = energize(lamp, kHeld);
  ASSERT_NE(host, nullptr);
  host->signal_guardian(SIGKILL);
  expect_end_at_zero(*host, lamp, [this] { return log(); });
}

TEST_F(GuardianTest, ThatIsFrozenWhileACurrentIsHeldEndsTheRun) {
  Usb amplifier;
  const std::unique_ptr<Host> host = energize(amplifier, kHeld);
  ASSERT_NE(host, nullptr);
  const EndedAtLast guardian{host->guardian()};
  host->signal_guardian(SIGSTOP);
  expect_end_at_zero(*host, amplifier, [this] { return log(); });
  EXPECT_TRUE(guardian_says("the process that guards the outputs does not answer")) << log();
  EXPECT_TRUE(time_until(1s, [&] { return has_ended(guardian.process); })) << "it is left behind";
}

TEST_F(GuardianTest, ThatIsFrozenWhileALightIsHeldEndsTheRun) {
  Lamp3103 lamp;
  const std::unique_ptr<Host> host = energize(lamp, kHeld);
  ASSERT_NE(host, nullptr);
  const EndedAtLast guardian{host->guardian()};
  host->signal_guardian(SIGSTOP);
  expect_end_at_zero(*host, lamp, [this] { return log(); });
  EXPECT_TRUE(guardian_says("the process that guards the outputs does not answer")) << log();
}

// Of the two, a host whose set-points come all the time has more to notice it by.
TEST_F(GuardianTest, ThatIsFrozenCostsAnAmplifierOnUsbItsCurrent) {
  Usb amplifier;
  int trial = 0;
  trials_of("USB-3103, guardian frozen",
            [&] { return trial_of_frozen(amplifier, trial++ % 2 == 0 ? kHeld : kProtocol); });
}

TEST_F(GuardianTest, ThatIsFrozenCostsAnAmplifierOnASerialLineItsCurrent) {
  Kepco amplifier;
  int trial = 0;
  trials_of("BOP, guardian frozen",
            [&] { return trial_of_frozen(amplifier, trial++ % 2 == 0 ? kHeld : kProtocol); });
}

constexpr const char* kLater = R"(
local s = require("units").s
return { title = "A current, after three seconds", needs = { "coils" }, parameters = {},
  run = function(rig, p, run)
    run:wait(3*s)
    local currents = {}
    for i = 1, #rig.coils:currents() do currents[i] = 1 end
    rig.coils:set_currents(currents)
    run:wait(3*s)
  end }
)";

TEST_F(GuardianTest, ThatIsFrozenBeforeTheFirstCurrentLetsNoneFlow) {
  Usb amplifier;
  Host host(folder, amplifier.rig(), kLater);
  ASSERT_TRUE(time_until(20s, [&] { return host.guardian() > 0; })) << log();
  std::this_thread::sleep_for(1s);  // it is ready, and the amplifier is open
  const EndedAtLast guardian{host.guardian()};
  host.signal_guardian(SIGSTOP);
  std::optional<int> status;
  double most = 0;
  time_until(20s, [&] {
    most = std::max(most, amplifier.output());
    return (status = host.status()).has_value();
  });
  EXPECT_LT(most, 1e-3) << "a current flowed without a guardian";
  ASSERT_TRUE(status && WIFEXITED(*status)) << log();
  EXPECT_TRUE(WEXITSTATUS(*status) == 1 || WEXITSTATUS(*status) == 4) << log();
  EXPECT_TRUE(guardian_says("does not answer")) << log();
}

// What it then reads is old: of a host that was silent, it would seem.
TEST_F(GuardianTest, ThatIsThawedTooLateNeitherKillsItsHostNorLetsTheOutputComeOnAgain) {
  Usb amplifier;
  for (const std::string when : {"at zero", "after a second", "after the end"}) {
    const std::unique_ptr<Host> host = energize(amplifier, kHeld);
    ASSERT_NE(host, nullptr);
    const EndedAtLast guardian{host->guardian()};
    const auto began = Steady::now();
    Frozen frozen(guardian.process);
    const auto zero = time_until(10s, [&] { return amplifier.output() < 1e-3; });
    ASSERT_TRUE(zero) << when << ": " << log();
    if (when == "after a second") std::this_thread::sleep_until(began + 1s);
    if (when != "after the end") frozen.thaw();
    EXPECT_EQ(exit_code(*host, 5s), 4) << when << ": " << log();
    frozen.thaw();
    EXPECT_FALSE(time_until(500ms, [&] { return amplifier.output() > 1e-3; })) << when;
    EXPECT_FALSE(guardian_says("vitreo guardian: ")) << when << ": " << log();
  }
}

// Also about the moment in which the host gives it up.
TEST_F(GuardianTest, ThatIsFrozenForAWhileNeverKillsItsHost) {
  Usb amplifier;
  int on = 0, ended = 0;
  for (int i = 0; i < trials() && !HasFailure(); ++i) {
    const std::unique_ptr<Host> host = energize(amplifier, kHeld);
    ASSERT_NE(host, nullptr);
    const EndedAtLast guardian{host->guardian()};
    {
      const Frozen frozen(guardian.process);
      std::this_thread::sleep_for(drawn(0, 0.4));
    }
    std::this_thread::sleep_for(400ms);
    const bool goes_on = amplifier.output() > 0.4;
    if (goes_on) host->signal(SIGINT);
    ++(goes_on ? on : ended);
    EXPECT_EQ(exit_code(*host, 20s), goes_on ? 3 : 4) << log();
    EXPECT_LT(amplifier.output(), 1e-3);
    EXPECT_FALSE(guardian_says("vitreo guardian: ")) << log();
  }
  std::printf("frozen for up to 0.4 s: %d runs went on, %d ended\n", on, ended);
}

// A supply that somebody switches off, or another program sets, while its current is held.
TEST_F(GuardianTest, ASupplyThatIsCutOffWhileItsCurrentIsHeldEndsTheRun) {
  Kepco amplifier;
  const std::unique_ptr<Host> host = energize(amplifier, kHeld);
  ASSERT_NE(host, nullptr);
  amplifier.end.look([&] { return amplifier.emulator->power_cycle(Time{}), 0; });
  expect_end_at_zero(*host, amplifier, [this] { return log(); });
  EXPECT_TRUE(guardian_says("A flow where 1 A were set")) << log();
}

/// A name like /dev/serial/by-id/..., which leads to what is plugged in.
void lead(const std::filesystem::path& name, const std::string& address) {
  std::filesystem::remove(name);
  std::filesystem::create_symlink(address.substr(std::string("serial:").size()), name);
}

TEST_F(GuardianTest, LeavesAloneWhoeverElseHasTheNameOfItsTerminalByNow) {
  const auto clock = wall_clock();
  const auto name = folder / "line";
  Kepco own;
  lead(name, own.end.address());
  guardian::Duty duty({"kepco_bop", "serial:" + name.string()});
  EchoPeer somebody;
  RealEnd elsewhere(somebody, open_pty_end());
  lead(name, elsewhere.address());
  for (int i = 0; i < 3; ++i) EXPECT_THROW(duty.bring_to_zero(*clock), DeviceError);
  EXPECT_EQ(elsewhere.look([&] { return somebody.heard; }), bytes("*IDN?\n")) << "asked once";
  Kepco replugged;
  lead(name, replugged.end.address());
  replugged.switch_on(*clock);
  EXPECT_NO_THROW(duty.bring_to_zero(*clock));
  EXPECT_FALSE(replugged.enabled());
  EXPECT_EQ(replugged.output(), 0);
}

TEST_F(GuardianTest, ZeroesTheUnitsThatItReachesWhenOneIsGone) {
  const auto clock = wall_clock();
  Kepco here;
  here.switch_on(*clock);
  guardian::Duty duty(
      {"kepco_bop", "serial:" + (folder / "gone").string() + ", " + here.end.address()});
  EXPECT_THROW(duty.bring_to_zero(*clock), DeviceError);
  EXPECT_FALSE(here.enabled());
  EXPECT_EQ(here.output(), 0);
}

TEST_F(GuardianTest, OutlivesTheControlGroupOfItsHost) {
  const ControlGroup group;
  if (!group.there()) GTEST_SKIP() << "wants cgroup v2 and the right to make a group";
  for (const bool shared : {false, true}) {
    Kepco amplifier;  // a testbed would put its own files in the place of /sys
    group.enter(getpid());
    const std::unique_ptr<Host> host = energize(amplifier, kHeld);
    group.leave();
    ASSERT_NE(host, nullptr);
    const pid_t guardian = host->guardian();
    ASSERT_GT(guardian, 0);
    // What the test can see: a guardian that is in the group dies with it.
    if (shared) group.enter(guardian);
    group.kill();
    const auto zero = time_until(2s, [&] { return amplifier.output() < 1e-3; });
    if (shared) {
      EXPECT_FALSE(zero) << "so a current flows on";
      continue;
    }
    ASSERT_TRUE(zero) << log();
    std::printf("control group killed: at zero after %.0f ms\n", zero->count());
    EXPECT_TRUE(time_until(5s, [&] { return guardian_says("is at zero"); })) << log();
  }
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
