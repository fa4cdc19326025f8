// Virtual clock: stops, errors, interrupts, deadlock, turns taken and shared against the header.
// SPDX-License-Identifier: Apache-2.0
#include "devices/time/clock.h"
#include "devices/time/turn_sharing.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <csignal>
#include <memory>
#include <stdexcept>
#include <string>
#include <thread>

namespace vitreo {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;

TEST(VirtualClockTurnsReference, a_stopped_task_leaves_this_and_every_later_wait_at_once) {
  const auto clock = virtual_clock();
  int stops = 0;
  Time first{0};
  const auto task = clock->spawn("t", [&] {
    for (int n = 0; n < 3; ++n) {
      try {
        clock->sleep_for(10s);
      } catch (const Stopped& stopped) {
        if (stops++ == 0) first = clock->now();
        EXPECT_STREQ(stopped.what(), "stopped");
      }
    }
    Signal signal;
    EXPECT_THROW(clock->wait(
                     signal, [] { return false; }, 20s),
                 Stopped);
    clock->outside([] {});  // no wait
    clock->sleep_for(1s);
    ADD_FAILURE() << "slept";
  });
  clock->sleep_until(3ms);
  EXPECT_FALSE(task->done());
  task->request_stop();
  EXPECT_EQ(stops, 0);
  task->join();  // what left the body is Stopped: no error
  EXPECT_TRUE(task->done());
  EXPECT_EQ(stops, 3);
  EXPECT_EQ(first, 3ms);
  EXPECT_EQ(clock->now(), 3ms);
}

TEST(VirtualClockTurnsReference,
     a_task_that_was_stopped_before_its_turn_feels_it_at_its_first_wait) {
  const auto clock = virtual_clock();
  clock->sleep_until(4ms);
  std::string did;
  const auto outer = clock->spawn("outer", [&] {
    const auto inner = clock->spawn("inner", [&] {
      did += "a";
      clock->inside([&] { did += "b"; });
      EXPECT_THROW(clock->sleep_until(0ns), Stopped);  // even one that need not wait
      did += "c";
      EXPECT_THROW(clock->sleep_for(1ms), Stopped);
    });
    inner->request_stop();
    EXPECT_FALSE(inner->done());
    inner->join();
    EXPECT_TRUE(inner->done());
    did += "d";
    clock->sleep_for(3ms);  // the other's stop is not its own
    EXPECT_THROW(clock->outside([] { throw std::out_of_range("through"); }), std::out_of_range);
  });
  outer->join();
  EXPECT_EQ(did, "abcd");
  EXPECT_EQ(clock->now(), 7ms);
}

TEST(VirtualClockTurnsReference, who_cleans_up_is_not_broken_off_and_is_stopped_afterwards) {
  const auto clock = virtual_clock();
  Time cleaned{0};
  Time stopped{0};
  const auto task = clock->spawn("t", [&] {
    {
      const StopShield shield(*clock);
      {
        const StopShield inner(*clock);
        clock->sleep_until(6ms);
      }
      clock->sleep_until(9ms);  // still the outer one's
      EXPECT_TRUE(clock->set_deaf(true));
      cleaned = clock->now();
    }
    EXPECT_FALSE(clock->set_deaf(false));
    try {
      clock->sleep_until(1s);
    } catch (const Stopped&) {
      stopped = clock->now();
      throw;
    }
  });
  clock->sleep_until(2ms);
  task->request_stop();
  task->join();
  EXPECT_EQ(cleaned, 9ms);
  EXPECT_EQ(stopped, 9ms);
  EXPECT_FALSE(clock->set_deaf(false));  // a task's own: the main task was never deaf
}

TEST(VirtualClockTurnsReference, what_a_body_throws_comes_out_of_join_and_out_of_nothing_else) {
  const auto clock = virtual_clock();
  const auto failing = [](Clock& on) {
    on.sleep_for(1ms);
    throw std::domain_error("so it is");
  };
  const auto task = clock->spawn("t", [&] { failing(*clock); });
  clock->sleep_until(5ms);
  EXPECT_TRUE(task->done());
  try {
    task->join();
    FAIL();
  } catch (const std::domain_error& error) {
    EXPECT_STREQ(error.what(), "so it is");
  }
  {
    const auto unheard = clock->spawn("u", [&] { failing(*clock); });
  }
  EXPECT_EQ(clock->now(), 5ms);  // its end stopped it before the millisecond was over
  bool ended = false;
  {
    const auto slow = clock->spawn("s", [&] {
      const StopShield shield(*clock);
      clock->sleep_until(8ms);
      ended = true;
    });
    clock->sleep_until(6ms);
  }
  EXPECT_TRUE(ended);
  EXPECT_EQ(clock->now(), 8ms);
}

Clock* g_clock = nullptr;

TEST(VirtualClockTurnsReference, an_interrupt_ends_one_wait_of_the_main_task_and_of_no_other) {
  const auto clock = virtual_clock();
  g_clock = clock.get();
  const auto before = std::signal(SIGUSR2, [](int) { g_clock->interrupt(); });
  std::raise(SIGUSR2);
  EXPECT_THROW(clock->sleep_for(1ms), Stopped);
  EXPECT_EQ(clock->now(), 0ns);
  clock->sleep_for(1ms);
  const auto task = clock->spawn("t", [&] {
    clock->sleep_until(4ms);
    clock->interrupt();
    clock->sleep_until(9ms);
  });
  Signal signal;
  EXPECT_THROW(clock->wait(
                   signal, [] { return false; }, kForever),
               Stopped);
  EXPECT_EQ(clock->now(), 4ms);
  {
    const StopShield shield(*clock);
    std::raise(SIGUSR2);
    clock->sleep_until(6ms);
  }
  EXPECT_THROW(clock->sleep_until(7ms), Stopped);
  EXPECT_EQ(clock->now(), 6ms);
  task->join();
  EXPECT_EQ(clock->now(), 9ms);
  std::signal(SIGUSR2, before);
}

TEST(VirtualClockTurnsReference, who_waits_for_ever_while_nobody_could_go_on_is_told_so) {
  const auto clock = virtual_clock();
  Signal signal;
  const auto never = [&] {
    clock->wait(
        signal, [] { return false; }, kForever);
  };
  const auto stuck = clock->spawn("stuck", never);
  const auto slow = clock->spawn("slow", [&] { clock->sleep_until(30ms); });
  std::string said;
  try {
    never();
  } catch (const std::logic_error& error) {
    said = error.what();
  }
  EXPECT_EQ(clock->now(), 30ms);  // not as long as one had a moment to wait for
  EXPECT_NE(said.find("no task can ever go on"), std::string::npos) << said;
  EXPECT_NE(said.find("main"), std::string::npos) << said;
  EXPECT_NE(said.find("stuck"), std::string::npos) << said;
  EXPECT_EQ(said.find("slow"), std::string::npos) << said;
  clock->sleep_until(40ms);  // and the clock goes on
  EXPECT_EQ(clock->now(), 40ms);
}

TEST(VirtualClockTurnsReference,
     a_thread_of_no_task_gets_the_turn_between_two_and_waits_like_a_task) {
  const auto clock = virtual_clock();
  std::atomic<bool> in{false};
  std::atomic<bool> forced{true};
  std::atomic<int> steps{0};
  int seen = -1;
  std::thread watchdog([&] {
    forced = clock->break_in(60s);
    EXPECT_FALSE(clock->displaced());
    const int before = steps;
    const Time then = clock->now();
    std::this_thread::sleep_for(2ms);
    EXPECT_EQ(steps, before);  // it holds the baton
    clock->sleep_for(3500us);
    EXPECT_EQ(clock->now(), then + 3500us);
    seen = steps - before;
    in = true;
    clock->leave();
  });
  while (!in) {
    clock->sleep_for(1ms);
    ++steps;
  }
  watchdog.join();
  EXPECT_FALSE(forced);
  EXPECT_GE(seen, 3);
  EXPECT_LE(seen, 4);
}

TEST(VirtualClockTurnsReference, it_takes_the_turn_from_who_does_not_give_it_back) {
  const auto clock = virtual_clock();
  clock->sleep_until(2ms);
  std::atomic<bool> taken{false};
  std::atomic<bool> left{false};
  Time back{0};
  std::thread watchdog([&] {
    const auto begin = std::chrono::steady_clock::now();
    EXPECT_TRUE(clock->break_in(20ms));
    EXPECT_GE(std::chrono::steady_clock::now() - begin, 20ms);
    EXPECT_TRUE(clock->displaced());
    EXPECT_EQ(clock->now(), 2ms);
    taken = true;
    for (int n = 0; n < 2000 && clock->displaced(); ++n) {
      std::this_thread::sleep_for(1ms);
      clock->sleep_for(10us);  // a turn in which it can come back
    }
    EXPECT_FALSE(clock->displaced());
    back = clock->now();
    left = true;
    clock->leave();
  });
  while (!taken) {
  }
  clock->sleep_for(1ms);  // blocks here
  watchdog.join();
  EXPECT_TRUE(left);
  EXPECT_GE(clock->now(), 3ms);
  EXPECT_LE(clock->now(), back + 1ms);
}

TEST(VirtualClockTurnsReference, without_a_pace_no_task_is_alone) {
  const auto clock = virtual_clock();
  TurnSharing* sharing = turn_sharing(*clock);
  ASSERT_NE(sharing, nullptr);
  EXPECT_FALSE(sharing->begin_alone());
  EXPECT_FALSE(sharing->end_alone());
  EXPECT_EQ(sharing->alone_for(), 0ns);
}

TEST(VirtualClockTurnsReference,
     who_computes_for_long_at_the_pace_of_the_wall_clock_lets_others_go_on) {
  const auto clock = virtual_clock(Pace::real_time);
  TurnSharing* sharing = turn_sharing(*clock);
  ASSERT_NE(sharing, nullptr);
  std::atomic<int> turns{0};
  bool both = true;
  const auto task = clock->spawn("a", [&] {
    ++turns;
    both = sharing->begin_alone();
    clock->sleep_for(1ms);
    ++turns;
  });
  EXPECT_FALSE(sharing->end_alone());
  EXPECT_TRUE(sharing->begin_alone());
  EXPECT_FALSE(sharing->begin_alone());
  EXPECT_TRUE(sharing->end_alone());
  EXPECT_FALSE(sharing->end_alone());
  EXPECT_EQ(sharing->alone_for(), 0ns);
  EXPECT_EQ(turns, 0);  // so short a time alone changes nothing
  EXPECT_TRUE(sharing->begin_alone());
  const auto begin = std::chrono::steady_clock::now();
  while (turns < 2 && std::chrono::steady_clock::now() - begin < 5s) {
  }
  EXPECT_GT(sharing->alone_for(), 5ms);
  EXPECT_EQ(turns, 2);
  EXPECT_TRUE(sharing->end_alone());
  EXPECT_EQ(sharing->alone_for(), 0ns);
  EXPECT_FALSE(both);  // one at a time
  task->join();
  EXPECT_TRUE(sharing->begin_alone());  // and again afterwards
  EXPECT_TRUE(sharing->end_alone());
}

TEST(VirtualClockTurnsReference, tells_for_how_long_the_turn_has_not_changed_hands) {
  const auto clock = virtual_clock(Pace::real_time);
  clock->sleep_for(2ms);
  const Time before = clock->stuck_for();
  std::this_thread::sleep_for(150ms);
  EXPECT_GE(clock->stuck_for() - before, 140ms);
  clock->sleep_for(2ms);
  EXPECT_LT(clock->stuck_for(), 140ms);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
