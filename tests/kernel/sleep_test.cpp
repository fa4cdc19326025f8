// A machine that is put to sleep (S3) while an output is energized, and wakes; the interface stands
// outside of it.
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

/// Largest output of the history between two moments of the double's clock.
double largest(const nlohmann::json& history, double from, double to) {
  double most = 0;
  double before = 0;
  for (const nlohmann::json& line : history) {
    if (line[1] != "volts") continue;
    double now = 0;
    for (const nlohmann::json& volts : line[2]) now = std::max(now, std::abs(volts.get<double>()));
    const double at = line[0].get<double>();
    if (at <= from) before = now;
    if (at > from && at <= to) most = std::max(most, now);
  }
  return std::max(most, before);
}

TEST(SleepGuest, OutputWhileTheMachineSleepsAndAfterItWakes) {
  load({"xhci-pci", "usbhid", "hid-generic"});
  ASSERT_TRUE(time_until(20s, [] { return std::filesystem::exists("/dev/hidraw0"); }));
  auto device = std::make_unique<Outside>("usb3103");
  Outside& outside = *device;
  Voltages amplifier(std::move(device));
  Host host(amplifier);
  host.energize();
  const double asleep = outside.order({{"now", true}}).at("now");
  const double boot = seconds(CLOCK_BOOTTIME);
  write_text("/sys/class/rtc/rtc0/wakealarm", "+4");
  write_text("/sys/power/state", "mem");
  const double away = seconds(CLOCK_BOOTTIME) - boot;
  const double awake = outside.order({{"now", true}}).at("now");
  std::this_thread::sleep_for(3s);
  const nlohmann::json history = outside.order({{"history", true}}).at("history");
  const double left = amplifier.output();
  const bool lives = host.lives();
  row("asleep for %.1f s (BOOTTIME %.1f s): %.2f V meanwhile; 3 s after waking %.2f V, the run %s",
      awake - asleep, away, largest(history, awake - 0.5, awake), left,
      lives ? "goes on" : "has ended");
  EXPECT_GT(awake - asleep, 2) << "it did not sleep";
  EXPECT_TRUE(lives || left < 2e-3) << "on, and no host: " << host.said();
}

}  // namespace
}  // namespace vitreo::kernel_guest
