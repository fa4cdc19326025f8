// A watchdog's thread that breaks into the virtual clock: in its turn where tasks wait, by force
// where one does not.
// SPDX-License-Identifier: Apache-2.0
#include "devices/time/clock.h"

#include <gtest/gtest.h>

#include <atomic>
#include <stdexcept>
#include <string>
#include <thread>
#include <utility>
#include <vector>

namespace vitreo {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;

TEST(Watchdog, GetsItsTurnInARealTimeWaitLongBeforeItsEnd) {
  const auto clock = virtual_clock(Pace::real_time);
  std::atomic<bool> forced{true};
  std::thread watchdog([&] {
    forced = clock->break_in(2s);
    clock->interrupt();
    clock->leave();
  });
  EXPECT_THROW(clock->sleep_for(1000s), Stopped);
  watchdog.join();
  EXPECT_FALSE(forced);
}

TEST(Watchdog, TakesTheTurnFromATaskThatDoesNotGiveItBackAndThatStandsStillAtItsNextCall) {
  const auto clock = virtual_clock();
  std::atomic<bool> taken{false}, let_go{false};
  std::vector<std::string> order;  // guarded by the baton
  std::thread watchdog([&] {
    EXPECT_TRUE(clock->break_in(10ms));
    EXPECT_TRUE(clock->displaced());
    taken = true;
    while (!let_go) std::this_thread::yield();
    order.push_back("watchdog");
    while (clock->displaced()) clock->sleep_for(1ms);
    clock->leave();
  });
  while (!taken) std::this_thread::yield();  // stuck: it holds the baton and makes no call
  let_go = true;
  clock->sleep_for(1s);  // stands still until its turn comes again
  order.push_back("stuck");
  watchdog.join();
  EXPECT_EQ(order, (std::vector<std::string>{"watchdog", "stuck"}));
  EXPECT_FALSE(clock->displaced());
  EXPECT_GE(clock->now(), 1s);
}

TEST(Watchdog, WorksWithOtherTasksWhileTheStuckOneIsAway) {
  const auto clock = virtual_clock();
  std::atomic<bool> finished{false};
  int ticks = 0;
  const auto task = clock->spawn("ticking", [&] {
    while (true) {
      clock->sleep_for(10ms);
      ++ticks;
    }
  });
  std::thread watchdog([&] {
    clock->break_in(0ms);
    clock->sleep_for(1s);
    finished = true;
    clock->leave();
  });
  while (!finished) std::this_thread::yield();
  clock->sleep_for(1ms);
  watchdog.join();
  EXPECT_GE(ticks, 99);
}

// A watchdog without patience comes between a hand-over and the moment at which the next task's
// thread has woken: that one waits for another turn, and is not one that does not come back.
TEST(Watchdog, ThatComesBetweenTwoTasksLosesNoneOfThem) {
  const auto clock = virtual_clock();
  std::atomic<bool> over{false};
  bool all_back = true;  // guarded by the baton
  std::thread watchdog([&] {
    for (int breaks = 0; breaks < 3000 && all_back; ++breaks) {
      clock->break_in(0ms);
      for (int looks = 0; clock->displaced() && all_back; ++looks) {
        all_back = looks < 1000;
        clock->sleep_for(1us);
        std::this_thread::sleep_for(10us);
      }
      clock->leave();
      std::this_thread::sleep_for(20us);
    }
    over = true;
  });
  while (!over) {
    // Ends of their own and by a stop, in the middle of it all.
    const auto brief = clock->spawn("brief", [&] { clock->sleep_for(50us); });
    const auto long_one = clock->spawn("long", [&] {
      while (true) clock->sleep_for(3us);
    });
    for (int i = 0; i < 20; ++i) clock->sleep_for(5us);
  }
  watchdog.join();
  EXPECT_TRUE(all_back);
}

// Between two looks at the clock, inside of a wait's own predicate: the task that lost the baton
// there must not pass on what it no longer holds.
void lose_the_turn_inside_of_a_predicate(std::unique_ptr<Clock> clock) {
  std::atomic<bool> taken{false}, out_of_turn{false}, inside{false};
  const auto other = clock->spawn("other", [&] {
    while (true) {
      if (inside) out_of_turn = true;
      clock->sleep_for(1ms);
    }
  });
  std::thread watchdog([&] {
    clock->break_in(0ms);
    inside = true;
    taken = true;
    std::this_thread::sleep_for(30ms);
    inside = false;
    clock->leave();
  });
  Signal signal;
  bool first = true;
  const auto ready = [&] {
    while (first && !taken) std::this_thread::yield();
    return !std::exchange(first, false);
  };
  EXPECT_TRUE(clock->wait(signal, ready, clock->now() + 10ms));
  clock->outside([&] { watchdog.join(); });
  EXPECT_FALSE(out_of_turn);
  EXPECT_FALSE(clock->displaced());
  EXPECT_NO_THROW(clock->sleep_for(5ms));
}

TEST(Watchdog, ATaskThatLosesTheTurnInsideOfItsPredicateDoesNotPassItOn) {
  lose_the_turn_inside_of_a_predicate(virtual_clock());
  lose_the_turn_inside_of_a_predicate(wall_clock());
}

TEST(Watchdog, BreaksIntoTheWallClockTooAndGivesTheBatonBack) {
  const auto clock = wall_clock();
  std::atomic<bool> taken{false}, left{false};
  std::thread watchdog([&] {
    EXPECT_TRUE(clock->break_in(10ms));
    taken = true;
    clock->sleep_for(5ms);
    EXPECT_TRUE(clock->displaced());
    clock->leave();
    left = true;
  });
  while (!left) std::this_thread::yield();  // stuck: it makes no call
  EXPECT_TRUE(taken);
  EXPECT_GE(clock->stuck_for(), 0ms);
  clock->sleep_for(1ms);
  EXPECT_FALSE(clock->displaced());
  watchdog.join();
}

TEST(Watchdog, AStuckTaskOfTheWallClockWaitsForItsTurnWhenItComesBack) {
  const auto clock = wall_clock();
  std::atomic<bool> taken{false};
  std::vector<std::string> order;  // guarded by the baton
  std::thread watchdog([&] {
    clock->break_in(0ms);
    taken = true;
    std::this_thread::sleep_for(20ms);
    order.push_back("watchdog");
    while (clock->displaced()) clock->sleep_for(1ms);
    clock->leave();
  });
  while (!taken) std::this_thread::yield();
  clock->sleep_for(1ms);
  order.push_back("stuck");
  clock->outside([&] { watchdog.join(); });  // it may still want a turn
  EXPECT_EQ(order, (std::vector<std::string>{"watchdog", "stuck"}));
}

TEST(Watchdog, TellsHowLongAProgramAtThePaceOfTheWallClockHasBeenStuck) {
  const auto clock = virtual_clock(Pace::real_time);
  clock->sleep_for(30ms);
  EXPECT_LT(clock->stuck_for(), 25ms);
  std::this_thread::sleep_for(40ms);
  EXPECT_GE(clock->stuck_for(), 40ms);
  EXPECT_EQ(virtual_clock()->stuck_for(), 0ms);
}

TEST(Watchdog, AForeignThreadThatDidNotBreakInIsStillRefused) {
  const auto clock = virtual_clock();
  std::thread([&] { EXPECT_THROW(clock->sleep_for(1ms), std::logic_error); }).join();
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
