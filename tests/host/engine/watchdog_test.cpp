// The watchdog of a run that ends while it is at work.
// SPDX-License-Identifier: Apache-2.0
#include "host/engine/watchdog.h"

#include <gtest/gtest.h>

#include <mutex>
#include <string>
#include <vector>

namespace vitreo {
namespace {

using namespace std::chrono_literals;

TEST(RunWatchdog, ThatMakesSafeWhenTheRunEndsIsWaitedForAndNotForEver) {
  const auto clock = virtual_clock();
  RunControl control;
  std::atomic<bool> begun{false}, ended{false};
  control.attach({[] {},
                  [&] {
                    begun = true;
                    clock->sleep_for(50ms);  // the devices take their time
                    ended = true;
                    return std::vector<std::string>();
                  }});
  {
    const Watchdog watchdog(control, *clock, {},
                            {[] {}, [] { return false; }, [](const std::string&) {}});
    control.request(StopTier::emergency);
    while (!begun) clock->sleep_for(1ms);  // now it has its turn, and this task has one too
  }
  EXPECT_TRUE(ended);
  EXPECT_TRUE(control.safe());
}

TEST(RunWatchdog, TellsHowFarAStopHasComeThatTakesItsTime) {
  const auto clock = virtual_clock();
  RunControl control;
  control.attach({[] {}, [] { return std::vector<std::string>(); }});
  std::mutex mutex;
  std::vector<std::string> told;
  const auto tell = [&](const std::string& text) {
    const std::lock_guard lock(mutex);
    told.push_back(text);
  };
  const auto times_told = [&] {
    const std::lock_guard lock(mutex);
    return told.size();
  };
  WatchdogLimits limits;
  limits.report_interval = 10ms;
  const Watchdog watchdog(control, *clock, limits,
                          {[] {}, [] { return false; }, [](const std::string&) {}, tell});
  control.request(StopTier::stop);
  while (times_told() < 1) clock->sleep_for(1ms);
  control.set_waiting_for("lens_mover:move_to");
  control.begin_stopping();
  while (times_told() < 2) clock->sleep_for(1ms);
  const std::lock_guard lock(mutex);
  EXPECT_EQ(told[0], "stop requested");
  EXPECT_EQ(told[1], "stopping, waiting for lens_mover:move_to");
}

}  // namespace
}  // namespace vitreo
