// The wall clock: real time, one baton, stops that arrive. These tests wait for real, a few
// milliseconds each.
// SPDX-License-Identifier: Apache-2.0
#include "devices/time/clock.h"
#include "devices/time/turn_sharing.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <exception>
#include <functional>
#include <stdexcept>
#include <thread>
#include <time.h>

namespace vitreo {
namespace VITREO_TEST_FILE {

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
  Signal signal;
  const auto refused = [&](const std::function<void()>& call) {
    std::exception_ptr error;
    std::thread([&] {
      try {
        call();
      } catch (...) {
        error = std::current_exception();
      }
    }).join();
    ASSERT_TRUE(error);
    EXPECT_THROW(std::rethrow_exception(error), std::logic_error);
  };
  refused([&] { clock->sleep_for(1ms); });
  refused([&] { clock->notify(signal); });
  refused([&] { clock->spawn("task", [] {}); });
}

TEST(WallClock, RefusesTheCallsOfATaskThatIsOutside) {
  const auto clock = wall_clock();
  clock->outside([&] {
    EXPECT_THROW(clock->sleep_for(1ms), std::logic_error);
    EXPECT_FALSE(turn_sharing(*clock)->end_alone()) << "it is not alone";
    clock->inside([&] { clock->sleep_for(1us); });
    EXPECT_THROW(clock->sleep_for(1ms), std::logic_error) << "outside again";
  });
}

TEST(WallClock, InterruptsTheMainTaskAndNoOther) {
  const auto clock = wall_clock();
  std::atomic<bool> finished{false};
  const auto other = clock->spawn("other", [&] {
    for (int i = 0; i < 20; ++i) clock->sleep_for(100us);
    finished = true;
  });
  clock->outside([&] {
    clock->interrupt();
    while (!other->done()) std::this_thread::sleep_for(1ms);
  });
  EXPECT_TRUE(finished);
  EXPECT_THROW(clock->sleep_for(1ms), Stopped);
}

TEST(WallClock, WakesATaskThatWaitsWithoutEndWhenItIsNotified) {
  const auto clock = wall_clock();
  Signal signal;
  bool there = false;
  std::atomic<bool> heard{false};
  const auto other = clock->spawn("other", [&] {
    clock->wait(
        signal, [&] { return there; }, kForever);
    heard = true;
  });
  clock->sleep_for(5ms);  // it waits by now
  there = true;
  clock->notify(signal);
  while (!heard && clock->now() < 10s) clock->sleep_for(1ms);
  EXPECT_TRUE(heard);
}

/// Of the calling thread, s.
double processor_time() {
  timespec used{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &used);
  return static_cast<double>(used.tv_sec) + 1e-9 * static_cast<double>(used.tv_nsec);
}

TEST(WallClock, UsesNoProcessorWhileItSleeps) {
  const auto clock = wall_clock();
  const double before = processor_time();
  clock->sleep_for(300ms);
  EXPECT_LT(processor_time() - before, 0.05);
}

TEST(WallClock, GivesTheOthersATurnWhereTheTimeHasPassedAlready) {
  const auto clock = wall_clock();
  std::atomic<bool> came{false};
  const auto other = clock->spawn("other", [&] { came = true; });
  while (!came && clock->now() < 10s) clock->sleep_until(Time(0));
  EXPECT_TRUE(came);
}

TEST(WallClock, TakesTheTurnBackForWhatIsDoneInside) {
  const auto clock = wall_clock();
  Signal signal;
  bool heard = false;
  const auto other = clock->spawn("other", [&] {
    clock->wait(
        signal, [&] { return heard; }, kForever);
  });
  std::atomic<bool> free_again{false};
  clock->outside([&] {
    clock->inside([&] {
      heard = true;
      clock->notify(signal);
      clock->sleep_for(1ms);
    });
    // Outside again: another task has its turn although this one does not wait.
    std::thread watchdog([&] {
      free_again = !clock->break_in(10s);
      clock->leave();
    });
    watchdog.join();
  });
  EXPECT_TRUE(free_again);
  clock->sleep_for(1us);
  other->join();
}

TEST(WallClock, LosesItsTurnInsideToAWatchdogAndWaitsForItsEnd) {
  const auto clock = wall_clock();
  std::atomic<bool> taken{false}, left{false};
  std::thread watchdog([&] {
    while (clock->stuck_for() == Time(0)) std::this_thread::yield();
    EXPECT_TRUE(clock->break_in(Time(0)));
    taken = true;
    std::this_thread::sleep_for(30ms);
    left = true;
    clock->leave();
  });
  clock->outside([&] {
    clock->inside([&] {
      while (!taken) std::this_thread::yield();  // stuck
    });
    EXPECT_TRUE(left);
  });
  watchdog.join();
  EXPECT_NO_THROW(clock->sleep_for(1us));
}

TEST(WallClock, RefusesTheCallsOfATaskThatIsAlone) {
  const auto clock = wall_clock();
  ASSERT_TRUE(turn_sharing(*clock)->begin_alone());
  EXPECT_THROW(clock->sleep_for(1ms), std::logic_error);
  EXPECT_FALSE(turn_sharing(*clock)->begin_alone()) << "it is already";
  ASSERT_TRUE(turn_sharing(*clock)->end_alone());
  EXPECT_NO_THROW(clock->sleep_for(1ms));
}

TEST(WallClock, CountsFromTheBreakInWhatAWatchdogHoldsItUp) {
  const auto clock = wall_clock();
  std::atomic<bool> over{false};
  Time before{}, after{};
  std::thread watchdog([&] {
    std::this_thread::sleep_for(300ms);
    before = clock->stuck_for();
    clock->break_in(Time(0));
    after = clock->stuck_for();
    clock->leave();
    over = true;
  });
  while (!over) std::this_thread::yield();
  watchdog.join();
  EXPECT_GE(before, 290ms);
  EXPECT_LT(after, before);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
