// A machine that sleeps (S3), or whose kernel panics, while an output is energized; the amplifier
// stands outside of it, and run.py judges what it does after a panic, the last case of a machine.
// SPDX-License-Identifier: Apache-2.0
#include "tests/kernel/guest.h"

#include <gtest/gtest.h>

#include <csignal>
#include <ctime>
#include <thread>

namespace vitreo::kernel_guest {
namespace {

double seconds(clockid_t clock) {
  timespec now{};
  ::clock_gettime(clock, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

/// Sleeps for 4 s, or stands frozen for 2, with the output on. Without a heartbeat line it stays on
/// meanwhile, which is told; what is on after waking has a host.
void expect_no_orphan(Amplifier& amplifier, const char* unit, bool freezes_only = false) {
  Host host(amplifier);
  host.energize();
  Instrument& outside = amplifier.instrument();
  const double asleep = outside.order({{"now", true}}).at("now");
  const double boot = seconds(CLOCK_BOOTTIME);
  if (freezes_only) {
    write_text("/sys/module/suspend/parameters/pm_test_delay", "2");
    write_text("/sys/power/pm_test", "devices");
    write_text("/sys/power/state", "freeze");
    write_text("/sys/power/pm_test", "none");
  } else {
    write_text("/sys/class/rtc/rtc0/wakealarm", "+4");
    write_text("/sys/power/state", "mem");
  }
  const double away = seconds(CLOCK_BOOTTIME) - boot;
  const double awake = outside.order({{"now", true}}).at("now");
  const double meanwhile = amplifier.output();  // nothing of the host has had time to act
  std::this_thread::sleep_for(3s);
  const bool lives = host.lives();  // first: one that ends in between has zeroed it
  const double left = amplifier.output();
  row("%s for %.1f s (BOOTTIME %.1f s): %.2f %s on waking; 3 s later %.2f %s, the run %s",
      freezes_only ? "user space frozen" : "asleep", awake - asleep, away, meanwhile, unit, left,
      unit, lives ? "goes on" : "has ended");
  EXPECT_GT(awake - asleep, 1.5) << "it did not sleep";
  EXPECT_TRUE(lives || left < 2e-3) << "on, and no host: " << host.said();
}

TEST(SleepGuest, OutputWhileTheMachineSleepsAndAfterItWakes) {
  load({"xhci-pci", "usbhid", "hid-generic"});
  wait_for_node("/dev/hidraw0");
  Voltages amplifier(std::make_unique<Outside>("usb3103"));
  expect_no_orphan(amplifier, "V");
}

TEST(BopOutsideGuest, OutputWhileUserSpaceIsFrozenAsForSleep) {
  load({"xhci-pci", "ftdi_sio"});
  Bop amplifier(std::make_unique<Outside>("supply"), adapter_node("BOP"));
  expect_no_orphan(amplifier, "A", true);
}

TEST(BopOutsideGuest, OutputWhileTheMachineSleepsAndAfterItWakes) {
  load({"xhci-pci", "ftdi_sio"});
  Bop amplifier(std::make_unique<Outside>("supply"), adapter_node("BOP"));
  expect_no_orphan(amplifier, "A");
}

void panic(Amplifier& amplifier) {
  Host host(amplifier);
  host.energize();
  send_line("LEAVE", "");
  write_text("/proc/sysrq-trigger", "c");
  std::this_thread::sleep_for(10s);
  FAIL() << "the kernel goes on";
}

TEST(PanicGuest, OfTheKernelWhileACurrentFlows) {
  load({"xhci-pci", "usbhid", "hid-generic"});
  wait_for_node("/dev/hidraw0");
  Voltages amplifier(std::make_unique<Outside>("usb3103"));
  panic(amplifier);
}

TEST(BopOutsideGuest, OfTheKernelWhileACurrentFlows) {
  load({"xhci-pci", "ftdi_sio"});
  Bop amplifier(std::make_unique<Outside>("supply"), adapter_node("BOP"));
  panic(amplifier);
}

}  // namespace
}  // namespace vitreo::kernel_guest
