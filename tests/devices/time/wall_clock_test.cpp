// The wall clock: real time, one baton, stops that arrive. These tests wait for real, a few
// milliseconds each.
// SPDX-License-Identifier: Apache-2.0
#include "devices/time/clock.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <stdexcept>
#include <thread>

namespace vitreo {
namespace {

using namespace std::chrono_literals;

TEST(WallClock, SleepsAtLeastAsLongAsAsked) {
  const auto clock = wall_clock();
  const Time start = clock->now();
  clock->sleep_for(5ms);
  EXPECT_GE(clock->now() - start, 5ms);
}

TEST(WallClock, WaitsUntilAnotherTaskNotifies) {
  const auto clock = wall_clock();
  Signal signal;
  bool there = false;
  const auto other = clock->spawn("other", [&] {
    clock->sleep_for(3ms);
    there = true;
    clock->notify(signal);
  });
  EXPECT_TRUE(clock->wait(
      signal, [&] { return there; }, kForever));
  EXPECT_FALSE(clock->wait(
      signal, [] { return false; }, clock->now() + 2ms));
}

TEST(WallClock, LetsOneTaskRunAtATime) {
  const auto clock = wall_clock();
  int inside = 0, most = 0;
  const auto work = [&] {
    for (int i = 0; i < 50; ++i) {
      most = std::max(most, ++inside);  // no lock: the baton is one
      std::this_thread::yield();
      --inside;
      clock->sleep_for(10us);
    }
  };
  const auto a = clock->spawn("a", work), b = clock->spawn("b", work);
  a->join();
  b->join();
  EXPECT_EQ(most, 1);
}

TEST(WallClock, LetsTheOthersGoOnWhileOneIsOutside) {
  const auto clock = wall_clock();
  std::atomic<bool> released{false};
  const auto other = clock->spawn("other", [&] {
    clock->sleep_for(1ms);
    released = true;
  });
  clock->outside([&] {  // would never end if it kept the baton
    while (!released) std::this_thread::sleep_for(100us);
  });
  EXPECT_TRUE(released);
  EXPECT_THROW(clock->outside([] { throw std::runtime_error("passes"); }), std::runtime_error);
  clock->sleep_for(1us);  // has the baton again
}

TEST(WallClock, EndsAWaitByAnInterruptOnce) {
  const auto clock = wall_clock();
  const auto operator_ = clock->spawn("operator", [&] {
    clock->sleep_for(2ms);
    clock->interrupt();
  });
  EXPECT_THROW(clock->sleep_for(10s), Stopped);
  EXPECT_NO_THROW(clock->sleep_for(1us));
  EXPECT_LT(clock->now(), 5s);
}

TEST(WallClock, StopsATaskButLetsItCleanUp) {
  const auto clock = wall_clock();
  bool clean = false;
  auto task = clock->spawn("task", [&] {
    try {
      clock->sleep_for(10s);
    } catch (const Stopped&) {
      const StopShield shield(*clock);
      clock->sleep_for(1ms);
      clean = true;
      throw;
    }
  });
  clock->sleep_for(1ms);
  task.reset();
  EXPECT_TRUE(clean);
  EXPECT_LT(clock->now(), 5s);
}

TEST(WallClock, PassesATasksErrorToWhoJoinsIt) {
  const auto clock = wall_clock();
  const auto task = clock->spawn("task", [] { throw std::runtime_error("broken"); });
  EXPECT_THROW(task->join(), std::runtime_error);
}

TEST(WallClock, RefusesAThreadWithoutTheBaton) {
  const auto clock = wall_clock();
  std::exception_ptr error;
  std::thread([&] {
    try {
      clock->sleep_for(1ms);
    } catch (...) {
      error = std::current_exception();
    }
  }).join();
  ASSERT_TRUE(error);
  EXPECT_THROW(std::rethrow_exception(error), std::logic_error);
}

}  // namespace
}  // namespace vitreo
