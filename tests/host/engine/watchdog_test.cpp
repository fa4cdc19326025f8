// The watchdog of a run that ends while it is at work.
// SPDX-License-Identifier: Apache-2.0
#include "host/engine/watchdog.h"

#include "devices/time/turn_sharing.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <functional>
#include <mutex>
#include <string>
#include <thread>
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

/// A run whose script is stuck: it holds the baton and makes no call. The limits are a tenth of the
/// usual, and so are the bounds.
struct StuckRun : testing::Test {
  using Steady = std::chrono::steady_clock;
  WatchdogLimits limits() const {
    WatchdogLimits limits;
    limits.clean_up = 600ms;
    limits.safe = 25ms;
    limits.grace = 500ms;
    limits.dead_man = 100ms;
    return limits;
  }
  void SetUp() override {
    control.attach({[] {},
                    [this] {
                      safe_at = since();
                      return std::vector<std::string>();
                    }});
  }
  std::chrono::milliseconds since() const {
    return std::chrono::duration_cast<std::chrono::milliseconds>(Steady::now() - began);
  }
  WatchdogActions actions() {
    return {[this] { given_up_at = since(); }, [this] { return energized.load(); },
            [this](const std::string& why) {
              tripped_at = since();
              tripped = why;
              energized = false;
            }};
  }
  /// Holds the baton for so long, or until `done`.
  void be_stuck(std::chrono::milliseconds most, const std::function<bool()>& done) const {
    const auto until = Steady::now() + most;
    while (Steady::now() < until && !done()) std::this_thread::yield();
  }
  RunControl control;
  std::atomic<bool> energized{false};
  std::atomic<std::chrono::milliseconds> safe_at{-1ms}, given_up_at{-1ms}, tripped_at{-1ms};
  std::string tripped;
  Steady::time_point began = Steady::now();
};

TEST_F(StuckRun, IsTrippedInRealTimeByTheDeadManOnceItIsEnergized) {
  const auto clock = virtual_clock(Pace::real_time);
  const Watchdog watchdog(control, *clock, limits(), actions());
  clock->sleep_for(1ms);
  be_stuck(400ms, [] { return false; });
  EXPECT_EQ(tripped_at.load(), -1ms) << "nothing is energized";
  clock->sleep_for(1ms);
  energized = true;
  began = Steady::now();
  be_stuck(2s, [&] { return tripped_at.load() >= 0ms; });
  EXPECT_GE(tripped_at.load(), 95ms);
  EXPECT_LT(tripped_at.load(), 400ms);
  EXPECT_EQ(tripped.find("dead-man: the host has not moved for "), 0u) << tripped;
  clock->sleep_for(1ms);  // it has come back
}

TEST_F(StuckRun, ThatComputesAloneIsNoDeadHostButHasItsOwnBound) {
  for (const auto& clock : {virtual_clock(Pace::real_time), wall_clock()}) {
    WatchdogLimits bounds = limits();
    bounds.dead_man = 250ms;
    bounds.grace = 67ms;  // twelve of them
    tripped_at = -1ms;
    tripped.clear();
    const Watchdog watchdog(control, *clock, bounds, actions());
    clock->sleep_for(1ms);
    energized = true;
    began = Steady::now();
    turn_sharing(*clock)->begin_alone();
    be_stuck(10s, [&] { return tripped_at.load() >= 0ms; });
    turn_sharing(*clock)->end_alone();
    EXPECT_GE(tripped_at.load(), 800ms);
    EXPECT_EQ(tripped.find("dead-man: the script has computed for "), 0u) << tripped;
    clock->sleep_for(1ms);
  }
}

TEST_F(StuckRun, IsNotTrippedOnTheVirtualClockWhereTimeStandsStillMeanwhile) {
  const auto clock = virtual_clock();
  const Watchdog watchdog(control, *clock, limits(), actions());
  energized = true;
  be_stuck(300ms, [] { return false; });
  EXPECT_EQ(tripped_at.load(), -1ms);
}

TEST_F(StuckRun, ThatComesBackAfterItWasMadeSafeIsNotGivenUp) {
  const auto clock = virtual_clock();
  const Watchdog watchdog(control, *clock, limits(), actions());
  control.request(StopTier::abort);
  be_stuck(2s, [&] { return safe_at.load() >= 0ms; });
  clock->sleep_for(1ms);
  while (clock->displaced()) clock->sleep_for(1ms);
  EXPECT_EQ(given_up_at.load(), -1ms);
  EXPECT_TRUE(control.safe());
}

}  // namespace
}  // namespace vitreo
