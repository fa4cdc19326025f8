// The watchdog of a run that ends while it is at work.
// SPDX-License-Identifier: Apache-2.0
#include "host/watchdog.h"

#include <gtest/gtest.h>

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
    const Watchdog watchdog(control, *clock, {}, {[] {}, [] { return false; }, [](const std::string&) {}});
    control.request(StopTier::emergency);
    while (!begun) clock->sleep_for(1ms);  // now it has its turn, and this task has one too
  }
  EXPECT_TRUE(ended);
  EXPECT_TRUE(control.safe());
}

}  // namespace
}  // namespace vitreo
