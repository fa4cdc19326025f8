// Virtual clock: threads that hold no turn are refused, one that was displaced waits for the
// watchdog's end, an interrupt gives no turn to a main task that does not come for it, and a new
// task is due now and not before.
// SPDX-License-Identifier: Apache-2.0
#include "devices/time/clock.h"
#include "devices/time/turn_sharing.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <functional>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

namespace vitreo {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;

/// Whether a thread of its own is refused by std::logic_error.
bool refused(const std::function<void()>& call) {
  bool found = false;
  std::thread([&] {
    try {
      call();
    } catch (const std::logic_error&) {
      found = true;
    }
  }).join();
  return found;
}

TEST(VirtualClockStrangers, EveryCallButNowIsRefused) {
  const auto clock = virtual_clock();
  Signal signal;
  EXPECT_TRUE(refused([&] { clock->sleep_for(1s); }));
  EXPECT_TRUE(refused([&] { clock->notify(signal); }));
  EXPECT_TRUE(refused([&] {
    clock->wait(
        signal, [] { return true; }, 1s);
  }));
  EXPECT_TRUE(refused([&] { static_cast<void>(clock->spawn("one", [] {})); }));
  EXPECT_TRUE(refused([&] { clock->leave(); }));
  EXPECT_TRUE(refused([&] { clock->set_deaf(true); }));
  EXPECT_FALSE(refused([&] { static_cast<void>(clock->now()); }));
  clock->sleep_for(1s);
  EXPECT_EQ(clock->now(), 1s);
}

TEST(VirtualClockStrangers, AreRefusedToWhileATaskIsDisplaced) {
  const auto clock = virtual_clock();
  bool forced = false, stranger = false;
  std::thread watchdog([&] {
    forced = clock->break_in(0ms);
    stranger = refused([&] { clock->sleep_for(1s); });
    clock->leave();
  });
  watchdog.join();
  EXPECT_TRUE(forced && stranger);
  clock->sleep_for(1s);  // it has its turn back, and never knew
  EXPECT_EQ(clock->now(), 1s);
}

TEST(VirtualClockStrangers, ADisplacedTaskThatCallsWaitsForTheWatchdogsEnd) {
  const auto clock = virtual_clock();
  std::atomic<bool> taken{false}, back{false};
  bool too_early = true;
  std::thread watchdog([&] {
    EXPECT_TRUE(clock->break_in(0ms));
    taken = true;
    std::this_thread::sleep_for(50ms);  // it calls meanwhile
    too_early = back;
    clock->leave();
  });
  while (!taken) std::this_thread::yield();
  Signal signal;
  clock->notify(signal);
  back = true;
  watchdog.join();
  EXPECT_FALSE(too_early);
}

TEST(VirtualClockStrangers, DoNotEndTheStretchOfATaskThatIsAlone) {
  const auto clock = virtual_clock(Pace::real_time);
  TurnSharing& turns = *turn_sharing(*clock);
  ASSERT_TRUE(turns.begin_alone());
  bool ended = true;
  EXPECT_FALSE(refused([&] { ended = turns.end_alone(); }));
  EXPECT_FALSE(ended);
  EXPECT_FALSE(refused([&] { EXPECT_FALSE(turns.begin_alone()); })) << "another is alone";
  EXPECT_TRUE(turns.end_alone());
}

// Else the watchdog itself would wait for what it is to stop.
TEST(VirtualClockStrangers, AnInterruptGivesNoTurnToAMainTaskThatIsDisplaced) {
  const auto clock = virtual_clock();
  std::atomic<bool> woke{false};
  std::thread watchdog([&] {
    EXPECT_TRUE(clock->break_in(0ms));
    clock->interrupt();
    clock->sleep_for(1ms);
    woke = true;
    clock->leave();
  });
  const auto until = std::chrono::steady_clock::now() + 2s;
  while (!woke && std::chrono::steady_clock::now() < until) std::this_thread::yield();
  EXPECT_TRUE(woke);
  EXPECT_THROW(clock->sleep_for(1s), Stopped);
  watchdog.join();
}

TEST(VirtualClockStrangers, AnInterruptGivesNoTurnToAMainTaskThatComputesAlone) {
  const auto clock = virtual_clock(Pace::real_time);
  std::atomic<int> ticks{0};
  const auto ticking = clock->spawn("ticking", [&] {
    while (true) {
      clock->sleep_for(2ms);
      ++ticks;
    }
  });
  clock->sleep_for(10ms);
  turn_sharing(*clock)->begin_alone();
  const auto until = std::chrono::steady_clock::now() + 3s;
  const auto computes_until = [&](int wanted) {  // it is passed by after 50 ms of processor time
    while (ticks < wanted && std::chrono::steady_clock::now() < until) {
    }
  };
  const int before = ticks;
  computes_until(before + 5);
  clock->interrupt();
  const int then = ticks;
  computes_until(then + 20);
  EXPECT_GE(ticks, then + 20);
  turn_sharing(*clock)->end_alone();
  // It is not away any more: a wait of it is broken off at once.
  const auto begun = std::chrono::steady_clock::now();
  EXPECT_THROW(clock->sleep_for(60s), Stopped);
  std::thread caller([&] {
    std::this_thread::sleep_for(50ms);
    clock->interrupt();
  });
  EXPECT_THROW(clock->sleep_for(60s), Stopped);
  EXPECT_LT(std::chrono::steady_clock::now() - begun, 30s);
  caller.join();
}

// By name where two are due at the same time, whenever they were made.
TEST(VirtualClockStrangers, ANewTaskIsDueNowAndNotBefore) {
  const auto clock = virtual_clock();
  std::vector<std::string> order;  // guarded by the turn
  const auto waiting = clock->spawn("n", [&] {
    clock->sleep_until(5s);
    order.emplace_back("n");
  });
  clock->sleep_until(5s);  // "main" is before "n"
  const auto made = clock->spawn("z", [&] { order.emplace_back("z"); });
  clock->sleep_for(1s);
  EXPECT_EQ(order, (std::vector<std::string>{"n", "z"}));
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
