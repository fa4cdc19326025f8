// A task that computes alone: at the pace of the wall clock the others have their turns beside it.
// SPDX-License-Identifier: Apache-2.0
#include "devices/time/clock.h"
#include "devices/time/turn_sharing.h"
#include "tests/machine_lateness.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <memory>
#include <string>
#include <thread>
#include <vector>

namespace vitreo {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;
using Steady = std::chrono::steady_clock;

void compute_for(Time duration) {
  for (const auto until = Steady::now() + duration; Steady::now() < until;) continue;
}

/// A loop that is due every 5 ms; how late its turns came by the wall.
struct TickingLoop {
  explicit TickingLoop(Clock& clock)
      : task(clock.spawn("loop", [this, &clock] {
          for (Time due = clock.now() + 5ms;; due += 5ms) {
            clock.sleep_until(due);
            const auto now = Steady::now();
            if (last != Steady::time_point{}) worst = std::max<Time>(worst, now - last - 5ms);
            last = now;
            ++turns;
          }
        })) {}
  Time worst{};
  int turns = 0;
  Steady::time_point last{};
  std::unique_ptr<Task> task;
};

/// What such a loop does on this machine, now, while the main task only waits.
struct Undisturbed {
  explicit Undisturbed(const std::unique_ptr<Clock>& clock, Time duration) {
    TickingLoop loop(*clock);
    clock->sleep_for(duration);
    turns = loop.turns;
    worst = loop.worst;
  }
  int turns = 0;
  Time worst{};
};

/// Whether a task that is alone for 400 ms by `compute` leaves a loop its turns, in time. Held up,
/// the loop would be late by most of the 400 ms in every attempt; a machine that holds up one
/// thread and not the one by which its lateness is measured does so now and then.
template <class Compute>
bool leaves_others_their_turns(const Compute& compute) {
  for (int attempt = 0; attempt < 3; ++attempt) {
    const auto clock = wall_clock();
    const Undisturbed usual(clock, 400ms);
    const MachineLateness machine;
    TickingLoop loop(*clock);
    clock->sleep_for(10ms);
    compute(*clock);
    const bool in_time = loop.worst < 10ms + 4 * std::max(machine.worst(), usual.worst);
    if (in_time && loop.turns > usual.turns / 3) return true;
  }
  return false;
}

TEST(TaskAlone, OfTheWallClockHoldsUpNoOther) {
  EXPECT_TRUE(leaves_others_their_turns([](Clock& clock) {
    turn_sharing(clock)->begin_alone();
    compute_for(400ms);
    EXPECT_GE(turn_sharing(clock)->alone_for(), 400ms);
    turn_sharing(clock)->end_alone();
    EXPECT_EQ(turn_sharing(clock)->alone_for(), 0ms);
  }));
}

TEST(TaskAlone, OfTheWallClockLeavesTheClockMoving) {
  const auto clock = wall_clock();
  const MachineLateness machine;
  TickingLoop loop(*clock);
  clock->sleep_for(10ms);
  turn_sharing(*clock)->begin_alone();
  compute_for(400ms);
  EXPECT_LT(clock->stuck_for(), 50ms + 2 * machine.worst());
  turn_sharing(*clock)->end_alone();
}

// Asked in a tight loop: who is last in line leaves a loop its turns.
TEST(TaskAlone, ThatComesForItsTurnAgainAndAgainLeavesTheOthersTheirs) {
  EXPECT_TRUE(leaves_others_their_turns([](Clock& clock) {
    for (const auto until = Steady::now() + 400ms; Steady::now() < until;) {
      turn_sharing(clock)->begin_alone();
      turn_sharing(clock)->end_alone();
      compute_for(100us);  // the host's own code, with the turn in hand
    }
  }));
}

TEST(TaskAlone, OfASimulationInRealTimeMayCallAgainAndAgainAsWell) {
  const auto clock = virtual_clock(Pace::real_time);
  const MachineLateness machine;
  TickingLoop loop(*clock);
  clock->sleep_for(10ms);
  Time stuck{};
  for (const auto until = Steady::now() + 800ms; Steady::now() < until;) {
    turn_sharing(*clock)->begin_alone();
    turn_sharing(*clock)->end_alone();
    compute_for(100us);
    stuck = std::max(stuck, clock->stuck_for());
  }
  EXPECT_LT(stuck, 120ms + 4 * machine.worst());
  // The others are let by each 110 ms at the latest, and a simulation that is behind goes on from
  // there: it is slower than without.
  EXPECT_GT(loop.turns, 5);
}

TEST(TaskAlone, OfASimulationInRealTimeIsPassedByTheOthersBeforeAnyDeadMan) {
  const auto clock = virtual_clock(Pace::real_time);
  const MachineLateness machine;
  TickingLoop loop(*clock);
  clock->sleep_for(10ms);
  const Time before = clock->now();
  turn_sharing(*clock)->begin_alone();
  Time stuck{};
  for (const auto until = Steady::now() + 600ms; Steady::now() < until;)
    stuck = std::max(stuck, clock->stuck_for());
  EXPECT_GT(clock->now() - before, 300ms) << "time went on without it";
  turn_sharing(*clock)->end_alone();
  const int turns = loop.turns;
  EXPECT_GT(turns, 60);
  EXPECT_LT(stuck, 120ms + 4 * machine.worst());
  clock->sleep_for(50ms);
  EXPECT_GT(loop.turns, turns);
}

// What a script computes between two calls is short: every run has the same turns.
TEST(TaskAlone, ForShortChangesNothingOfTheOrderOfASimulationInRealTime) {
  const auto order_of = [](bool alone) {
    const auto clock = virtual_clock(Pace::real_time);
    std::string order;
    const auto other = clock->spawn("other", [&] {
      while (true) {
        order += "o" + std::to_string(clock->now().count());
        clock->sleep_for(1ms);
      }
    });
    for (int i = 0; i < 20; ++i) {
      if (alone) turn_sharing(*clock)->begin_alone();
      compute_for(2ms);  // longer than the other's period
      if (alone) turn_sharing(*clock)->end_alone();
      order += "m" + std::to_string(clock->now().count());
      clock->sleep_for(3ms);
    }
    return order;
  };
  EXPECT_EQ(order_of(true), order_of(false));
}

TEST(TaskAlone, StopsTheTimeWhereNothingKeepsThePaceOfTheWall) {
  const auto clock = virtual_clock();
  TickingLoop loop(*clock);
  clock->sleep_for(10ms);
  const int turns = loop.turns;
  const Time before = clock->now();
  turn_sharing(*clock)->begin_alone();
  compute_for(300ms);
  EXPECT_EQ(clock->now(), before);
  EXPECT_EQ(loop.turns, turns);
  turn_sharing(*clock)->end_alone();
  EXPECT_EQ(clock->now(), before);
}

TEST(TaskAlone, IsNoDeadlockForThoseThatWaitForIt) {
  const auto clock = virtual_clock(Pace::real_time);
  Signal signal;
  bool come = false, heard = false;
  const auto other = clock->spawn("other", [&] {
    clock->wait(
        signal, [&] { return come; }, kForever);
    heard = true;
  });
  clock->sleep_for(1ms);
  turn_sharing(*clock)->begin_alone();
  compute_for(300ms);  // all others wait without a deadline meanwhile
  turn_sharing(*clock)->end_alone();
  come = true;
  clock->notify(signal);
  clock->sleep_for(1ms);
  EXPECT_TRUE(heard);
}

void break_into(const std::unique_ptr<Clock>& clock) {
  clock->sleep_for(1ms);
  std::atomic<bool> over{false};
  bool forced = true;
  turn_sharing(*clock)->begin_alone();
  compute_for(300ms);
  std::thread watchdog([&] {
    forced = clock->break_in(1s);
    clock->sleep_for(5ms);
    clock->leave();
    over = true;
  });
  // The thread comes and goes while this task computes on, though nothing else is ever due.
  for (const auto until = Steady::now() + 10s; !over && Steady::now() < until;) continue;
  EXPECT_TRUE(over);
  turn_sharing(*clock)->end_alone();
  clock->sleep_for(1ms);
  clock->outside([&] { watchdog.join(); });
  EXPECT_FALSE(forced);
  EXPECT_FALSE(clock->displaced());
}

TEST(TaskAlone, LetsAWatchdogComeAndGo) {
  break_into(virtual_clock(Pace::real_time));
  break_into(wall_clock());
}

TEST(TaskAlone, FeelsAnInterruptAtItsNextWait) {
  for (const auto& clock : {virtual_clock(Pace::real_time), wall_clock()}) {
    turn_sharing(*clock)->begin_alone();
    compute_for(250ms);
    clock->interrupt();
    turn_sharing(*clock)->end_alone();
    EXPECT_THROW(clock->sleep_for(10s), Stopped);
  }
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
