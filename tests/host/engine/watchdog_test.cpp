// The watchdog of a run that ends while it is at work.
// SPDX-License-Identifier: Apache-2.0
#include "host/engine/watchdog.h"

#include "devices/time/turn_sharing.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <utility>
#include <vector>

namespace vitreo {
namespace VITREO_TEST_FILE {

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
              tripped = why;
              tripped_at = since();  // who sees this may read why
              energized = false;
            }};
  }
  /// Holds the baton for so long, or until `done`, and computes: who yields is not seen to compute
  /// where the machine is busy.
  void be_stuck(std::chrono::milliseconds most, const std::function<bool()>& done) const {
    const auto until = Steady::now() + most;
    while (Steady::now() < until && !done()) continue;
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

TEST_F(StuckRun, ThatWasMadeSafeLetsTheOthersGoOnWhileItIsStuck) {
  const auto clock = virtual_clock();
  std::atomic<int> ticks{0};
  const auto task = clock->spawn("ticking", [&] {
    while (true) {
      clock->sleep_for(1ms);
      ++ticks;
    }
  });
  WatchdogLimits bounds = limits();
  bounds.grace = 60s;
  const Watchdog watchdog(control, *clock, bounds, actions());
  clock->sleep_for(1ms);
  control.request(StopTier::abort);
  be_stuck(10s, [&] { return safe_at.load() >= 0ms; });
  const int before = ticks;
  be_stuck(10s, [&] { return ticks > before + 5; });
  EXPECT_GT(ticks, before + 5);
}

TEST_F(StuckRun, ThatEndsWhileItsCoilsAreTrippedWaitsForThem) {
  const auto clock = virtual_clock(Pace::real_time);
  std::atomic<bool> begun{false}, ended{false};
  WatchdogActions slow = actions();
  slow.trip = [&](const std::string&) {
    begun = true;
    // The amplifier takes its time, in which the script has its turn again.
    for (int i = 0; i < 30; ++i) {
      clock->sleep_for(1ms);
      std::this_thread::sleep_for(2ms);
    }
    energized = false;
    ended = true;
  };
  {
    const Watchdog watchdog(control, *clock, limits(), slow);
    clock->sleep_for(1ms);
    energized = true;
    be_stuck(5s, [&] { return begun.load(); });
  }
  EXPECT_TRUE(ended);
}

/// A clock that says what it is told to, and notes who breaks in with which patience.
class ScriptedClock : public Clock, public TurnSharing {
 public:
  Time now() const override { return std::chrono::steady_clock::now().time_since_epoch(); }
  void sleep_until(Time due) override { std::this_thread::sleep_for(due - now()); }
  bool wait(Signal&, const std::function<bool()>& ready, Time) override { return ready(); }
  void notify(Signal&) override {}
  std::unique_ptr<Task> spawn(std::string, std::function<void()>) override { return nullptr; }
  void interrupt() noexcept override {}
  bool set_deaf(bool deaf) override { return std::exchange(deaf_, deaf); }
  bool break_in(Time patience) override {
    const std::lock_guard lock(mutex_);
    patiences_.push_back(patience);
    return true;
  }
  bool displaced() override { return true; }
  void leave() override { ++left; }
  Time stuck_for() const noexcept override {
    ++polls;
    return stuck;
  }
  bool begin_alone() override { return false; }
  bool end_alone() override { return false; }
  Time alone_for() const noexcept override { return alone; }
  std::vector<Time> patiences() const {
    const std::lock_guard lock(mutex_);
    return patiences_;
  }

  std::atomic<Time> stuck{Time(0)}, alone{Time(0)};
  std::atomic<int> left{0};
  mutable std::atomic<int> polls{0};

 private:
  mutable std::mutex mutex_;
  std::vector<Time> patiences_;
  bool deaf_ = false;
};

/// The watchdog beside a script that never comes: what it does, and when.
struct WatchedRun : StuckRun {
  /// True as soon as `holds` does; after `most`, what it is then.
  static bool within(std::chrono::milliseconds most, const std::function<bool()>& holds) {
    const auto until = Steady::now() + most;
    while (Steady::now() < until && !holds()) std::this_thread::sleep_for(1ms);
    return holds();
  }
  bool broke_in() const { return !clock.patiences().empty(); }
  ScriptedClock clock;
};

TEST_F(WatchedRun, IsTrippedAboveItsBoundAndAtOnce) {
  const Watchdog watchdog(control, clock, limits(), actions());
  energized = true;
  clock.stuck = limits().dead_man;
  EXPECT_FALSE(within(200ms, [&] { return broke_in(); })) << "the bound itself is allowed";
  clock.stuck = limits().dead_man + 1ns;
  ASSERT_TRUE(within(10s, [&] { return clock.left > 0; }));
  EXPECT_EQ(clock.patiences()[0], Time(0)) << "what does not move is not waited for";
  EXPECT_EQ(tripped, "dead-man: the host has not moved for 100 ms");
}

TEST_F(WatchedRun, WhoseScriptComputesForTooLongHasTheTimeOfAnAbortToPutItsTurnDown) {
  const Watchdog watchdog(control, clock, limits(), actions());
  clock.alone = 12 * limits().grace + 1ns;
  EXPECT_FALSE(within(200ms, [&] { return broke_in(); })) << "nothing is energized";
  clock.alone = 12 * limits().grace;
  energized = true;
  EXPECT_FALSE(within(200ms, [&] { return broke_in(); })) << "the bound itself is allowed";
  clock.alone = 12 * limits().grace + 1ns;
  ASSERT_TRUE(within(10s, [&] { return clock.left > 0; }));
  EXPECT_EQ(clock.patiences()[0], Time(limits().safe));
  EXPECT_EQ(tripped, "dead-man: the script has computed for 6000 ms without a call to the host");
}

TEST_F(WatchedRun, IsLookedAtTwentyTimesASecondAndAtItsEndFiftyTimes) {
  const Watchdog watchdog(control, clock, limits(), actions());
  within(500ms, [] { return false; });
  const int idle = clock.polls;
  EXPECT_LE(idle, 12);
  control.request(StopTier::stop);
  within(500ms, [] { return false; });
  EXPECT_LE(clock.polls - idle, 28);
  // A busy machine makes both fewer, and the period at the end shows only where there was time.
  EXPECT_TRUE(clock.polls - idle > 12 || idle < 9) << idle << ", " << clock.polls;
}

TEST_F(WatchedRun, WhoseCleanUpTakesTooLongIsAborted) {
  WatchdogLimits bounds = limits();
  bounds.clean_up = 100ms;
  bounds.grace = 60s;
  const Watchdog watchdog(control, clock, bounds, actions());
  control.request(StopTier::stop, "of the operator");
  ASSERT_TRUE(within(10s, [&] { return control.tier() == StopTier::abort; }));
  EXPECT_GE(*control.since(StopTier::stop), 100ms);
  EXPECT_EQ(control.reason(), "of the operator; its clean-up took too long after the stop");
  EXPECT_EQ(control.cause().by, "watchdog");
}

TEST_F(WatchedRun, ThatIsAbortedIsMadeSafeAfterItsPatienceAndInAnEmergencyAtOnce) {
  WatchdogLimits bounds = limits();
  bounds.safe = 200ms;
  bounds.grace = 60s;
  {
    const Watchdog watchdog(control, clock, bounds, actions());
    began = Steady::now();
    control.request(StopTier::abort);
    EXPECT_TRUE(within(10s, [&] { return safe_at.load() >= 0ms; }));
    EXPECT_GE(safe_at.load(), 199ms);
  }
  bounds.safe = 60s;
  RunControl another;
  std::atomic<bool> made_safe{false};
  another.attach({[] {},
                  [&] {
                    made_safe = true;
                    return std::vector<std::string>();
                  }});
  const Watchdog watchdog(another, clock, bounds, actions());
  another.request(StopTier::emergency);
  EXPECT_TRUE(within(10s, [&] { return made_safe.load(); }));
}

TEST_F(WatchedRun, ThatMadeItselfSafeIsLeftAloneUntilItIsGivenUp) {
  WatchdogLimits bounds = limits();
  bounds.safe = 10ms;
  bounds.grace = 400ms;
  const Watchdog watchdog(control, clock, bounds, actions());
  control.make_safe();
  began = Steady::now();
  control.request(StopTier::abort);
  within(200ms, [&] { return broke_in(); });
  if (since() < bounds.grace) {
    EXPECT_FALSE(broke_in());
  }
  EXPECT_TRUE(within(10s, [&] { return given_up_at.load() >= 0ms; }));
  EXPECT_GE(given_up_at.load(), 399ms);
  EXPECT_EQ(control.status().phase, RunPhase::not_responding);
}

TEST_F(WatchedRun, WhoseAbortedStatementHasEndedAtThePromptIsNotGivenUp) {
  WatchdogLimits bounds = limits();
  bounds.clean_up = 50ms;
  bounds.grace = 100ms;
  for (const StopTier tier : {StopTier::stop, StopTier::abort, StopTier::emergency}) {
    RunControl prompt;
    prompt.attach({[] {}, [] { return std::vector<std::string>(); }});
    const Watchdog watchdog(prompt, clock, bounds, actions());
    prompt.request(tier, "of Ann");
    prompt.begin_stopping();
    prompt.make_safe();
    prompt.set_idle(true);
    within(400ms, [&] { return given_up_at.load() >= 0ms; });
    EXPECT_LT(given_up_at.load(), 0ms) << to_string(tier);
    EXPECT_EQ(prompt.status().phase, RunPhase::ready);
    EXPECT_EQ(prompt.reason(), "of Ann") << "no clean-up took too long";
    prompt.detach();
  }
}

TEST_F(WatchedRun, ThatComesToItsEndWhileItIsMadeSafeByForceIsNotGivenUp) {
  WatchdogLimits bounds = limits();
  bounds.safe = 10ms;
  bounds.grace = 400ms;
  const Watchdog watchdog(control, clock, bounds, actions());
  control.request(StopTier::abort);
  ASSERT_TRUE(within(10s, [&] { return safe_at.load() >= 0ms; }));
  control.set_idle(true);
  EXPECT_TRUE(within(10s, [&] { return clock.left > 0; }));
  within(600ms, [&] { return given_up_at.load() >= 0ms; });
  EXPECT_LT(given_up_at.load(), 0ms);
}

TEST_F(WatchedRun, WhosePromptDoesNotComeIsMadeSafeForAStopBetweenTwoStatements) {
  WatchdogLimits bounds = limits();
  bounds.safe = 200ms;
  const Watchdog watchdog(control, clock, bounds, actions());
  control.set_idle(true);
  EXPECT_FALSE(within(300ms, [&] { return broke_in(); })) << "nothing is asked";
  began = Steady::now();
  control.request(StopTier::stop, "of the pedal", {"device", "pedal"});
  EXPECT_TRUE(within(10s, [&] { return safe_at.load() >= 0ms; }));
  EXPECT_GE(safe_at.load(), 199ms) << "the prompt's own time comes first";
  ASSERT_TRUE(within(10s, [&] { return clock.left > 0; }));
  EXPECT_EQ(clock.patiences()[0], Time(5ms));
  EXPECT_EQ(control.take_answered()->reason, "of the pedal");
  EXPECT_FALSE(within(300ms, [&] { return clock.left > 1; })) << "once";
}

TEST_F(WatchedRun, TellsWhatChangedOnceAnInterval) {
  std::mutex mutex;
  std::vector<std::pair<std::string, std::chrono::milliseconds>> told;
  WatchdogActions telling = actions();
  telling.report = [&](const std::string& text) {
    const std::lock_guard lock(mutex);
    told.emplace_back(text, since());
  };
  const auto times_told = [&] {
    const std::lock_guard lock(mutex);
    return told.size();
  };
  WatchdogLimits bounds = limits();
  bounds.clean_up = 60s;
  bounds.report_interval = 150ms;
  const Watchdog watchdog(control, clock, bounds, telling);
  began = Steady::now();
  control.request(StopTier::stop);
  ASSERT_TRUE(within(10s, [&] { return times_told() == 1; }));
  control.make_safe();  // a change, at once
  ASSERT_TRUE(within(10s, [&] { return times_told() == 2; }));
  EXPECT_FALSE(within(500ms, [&] { return times_told() > 2; })) << "nothing has changed";
  const std::lock_guard lock(mutex);
  EXPECT_EQ(told[0].first, "stop requested");
  EXPECT_GE(told[0].second, 149ms);
  EXPECT_EQ(told[1].first, "stop requested; the devices are safe");
  EXPECT_GE(told[1].second - told[0].second, 149ms);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
