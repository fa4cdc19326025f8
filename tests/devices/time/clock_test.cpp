// The virtual clock: order, repeatability, pace.
// SPDX-License-Identifier: Apache-2.0
#include "devices/time/clock.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <memory>
#include <random>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

namespace vitreo {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;

std::chrono::nanoseconds wall_time_of(const std::function<void()>& work) {
  const auto start = std::chrono::steady_clock::now();
  work();
  return std::chrono::steady_clock::now() - start;
}

TEST(Seconds, BecomeWholeNanosecondsToTheNearest) {
  EXPECT_EQ(from_seconds(1.5), 1500ms);
  EXPECT_EQ(from_seconds(-0.25e-9), 0ns);
  EXPECT_EQ(from_seconds(0.6e-9), 1ns);
  EXPECT_DOUBLE_EQ(to_seconds(from_seconds(0.0667)), 0.0667);
}

TEST(Seconds, ThatAreNoTimeAreRefused) {
  EXPECT_THROW(from_seconds(std::nan("")), std::invalid_argument);
  EXPECT_THROW(from_seconds(std::numeric_limits<double>::infinity()), std::invalid_argument);
  EXPECT_THROW(from_seconds(1e10), std::invalid_argument);
  EXPECT_THROW(from_seconds(-1e10), std::invalid_argument);
  EXPECT_NO_THROW(from_seconds(9e9));
}

TEST(Seconds, AddedToForeverStayForever) {
  EXPECT_EQ(later(5s, kForever), kForever);
  EXPECT_EQ(later(5s, 3s), 8s);
}

TEST(VirtualClock, JumpsToTheNextEventWithoutWaiting) {
  const auto clock = virtual_clock();
  EXPECT_EQ(clock->now(), 0ns);
  EXPECT_LT(wall_time_of([&] { clock->sleep_for(24h); }), 5s);
  EXPECT_EQ(clock->now(), 24h);
}

TEST(VirtualClock, DoesNotGoBackForAPassedTime) {
  const auto clock = virtual_clock();
  clock->sleep_until(2s);
  clock->sleep_until(1s);
  EXPECT_EQ(clock->now(), 2s);
}

TEST(VirtualClock, RunsTasksByDueTimeAndThenByName) {
  const auto clock = virtual_clock();
  std::string trace;
  const auto body = [&](std::string name, Time due) {
    return [&trace, &clock, name, due] {
      clock->sleep_until(due);
      trace += name;
    };
  };
  const auto d = clock->spawn("d", body("d", 1s));
  const auto c = clock->spawn("c", body("c", 2s));
  const auto b = clock->spawn("b", body("b", 2s));
  const auto a = clock->spawn("a", body("a", 2s));
  const auto e = clock->spawn("e", body("e", 1s));
  clock->sleep_until(3s);
  EXPECT_EQ(trace, "deabc");
}

TEST(VirtualClock, RunsTasksOfTheSameNameInOrderOfBirth) {
  const auto clock = virtual_clock();
  std::string trace;
  const auto first = clock->spawn("twin", [&] { trace += "1"; });
  const auto second = clock->spawn("twin", [&] { trace += "2"; });
  clock->sleep_for(1s);
  EXPECT_EQ(trace, "12");
}

TEST(VirtualClock, StartsASpawnedTaskWhenTheSpawnerWaits) {
  const auto clock = virtual_clock();
  bool ran = false;
  const auto task = clock->spawn("task", [&] { ran = true; });
  EXPECT_FALSE(ran);
  EXPECT_FALSE(task->done());
  clock->sleep_for(1ns);
  EXPECT_TRUE(ran);
  EXPECT_TRUE(task->done());
}

TEST(VirtualClock, WakesAWaiterWhenItsConditionHolds) {
  const auto clock = virtual_clock();
  Signal changed;
  int value = 0;
  const auto writer = clock->spawn("writer", [&] {
    while (value < 3) {
      clock->sleep_for(10ms);
      ++value;
      clock->notify(changed);
    }
  });
  EXPECT_TRUE(clock->wait(
      changed, [&] { return value == 3; }, 1s));
  EXPECT_EQ(clock->now(), 30ms);
  EXPECT_FALSE(clock->wait(
      changed, [&] { return value == 4; }, 1s));
  EXPECT_EQ(clock->now(), 1s);
}

TEST(VirtualClock, LetsAWaiterGoOnWaitingWhenAnotherTookWhatItWaitedFor) {
  const auto clock = virtual_clock();
  Signal filled;
  int items = 0;
  std::string trace;
  const auto taker = [&](std::string name) {
    return [&, name] {
      trace += clock->wait(
                   filled, [&] { return items > 0; }, 1s)
                   ? name
                   : "-";
      if (items > 0) --items;
    };
  };
  const auto a = clock->spawn("a", taker("a"));
  const auto b = clock->spawn("b", taker("b"));
  clock->sleep_until(100ms);
  items = 1;
  clock->notify(filled);
  clock->sleep_until(200ms);
  EXPECT_EQ(trace, "a");
  clock->sleep_until(2s);
  EXPECT_EQ(trace, "a-");
}

TEST(VirtualClock, PassesAnExceptionOfTheConditionToItsWaiter) {
  const auto clock = virtual_clock();
  Signal signal;
  const auto bad = []() -> bool { throw std::runtime_error("bad condition"); };
  EXPECT_THROW(clock->wait(signal, bad, 1s), std::runtime_error);
}

std::string interleaving(unsigned seed) {
  const auto clock = virtual_clock();
  Signal changed;
  int shared = 0;
  std::string trace;
  std::vector<std::unique_ptr<Task>> tasks;
  for (int i = 0; i < 6; ++i) {
    tasks.push_back(clock->spawn("task" + std::to_string(i), [&, i] {
      std::mt19937 random(seed + static_cast<unsigned>(i));
      for (int step = 0; step < 30; ++step) {
        const Time pause(random() % 4 * 1000000);
        if (random() % 3 == 0)
          clock->wait(
              changed, [&, wanted = shared + 2] { return shared >= wanted; },
              later(clock->now(), pause));
        else
          clock->sleep_for(pause);
        ++shared;
        clock->notify(changed);
        trace += std::to_string(i) + "@" + std::to_string(clock->now().count() / 1000000) + " ";
      }
    }));
  }
  for (const auto& task : tasks) task->join();
  return trace;
}

TEST(VirtualClock, InterleavesTheSameWayInAHundredRuns) {
  const std::string first = interleaving(1);
  EXPECT_EQ(std::count(first.begin(), first.end(), ' '), 6 * 30);
  for (int run = 0; run < 100; ++run) ASSERT_EQ(interleaving(1), first) << "run " << run;
  EXPECT_NE(interleaving(2), first);
}

TEST(VirtualClock, RefusesAThreadThatHoldsNoBaton) {
  const auto clock = virtual_clock();
  bool refused = false;
  std::thread([&] {
    try {
      clock->sleep_for(1s);
    } catch (const std::logic_error&) {
      refused = true;
    }
  }).join();
  EXPECT_TRUE(refused);
}

TEST(RealTimePace, KeepsToTheWallClock) {
  int ticks = 0;
  const auto wall = wall_time_of([&] {  // the clock's time begins as it is made
    const auto clock = virtual_clock(Pace::real_time);
    const auto ticker = clock->spawn("ticker", [&] {
      for (;; clock->sleep_for(5ms)) ++ticks;
    });
    clock->sleep_until(50ms);
  });
  EXPECT_EQ(ticks, 10);  // at 0, 5, ... 45 ms; at 50 ms "main" goes first
  EXPECT_GE(wall, 49ms);
  EXPECT_LT(wall, 500ms);  // generous: the machine may be busy
}

TEST(RealTimePace, HearsAnInterruptInALongWait) {
  const auto clock = virtual_clock(Pace::real_time);
  std::thread console([&] {
    const auto pressed = std::chrono::steady_clock::now() + 30ms;
    while (std::chrono::steady_clock::now() < pressed) std::this_thread::yield();
    clock->interrupt();
  });
  const auto wall = wall_time_of([&] { EXPECT_THROW(clock->sleep_for(1h), Stopped); });
  console.join();
  EXPECT_LT(wall, 500ms);  // 30 ms and one slice of 10 ms; generous: the machine may be busy
  EXPECT_GE(clock->now(), 20ms);
  EXPECT_LT(clock->now(), 500ms);
}

TEST(RealTimePace, DoesNotRushAfterATaskThatHeldTheBatonForLong) {
  const auto clock = virtual_clock(Pace::real_time);
  const auto thinking = std::chrono::steady_clock::now() + 250ms;
  while (std::chrono::steady_clock::now() < thinking) std::this_thread::yield();
  clock->sleep_for(1ms);
  EXPECT_GE(wall_time_of([&] { clock->sleep_for(40ms); }), 39ms);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
