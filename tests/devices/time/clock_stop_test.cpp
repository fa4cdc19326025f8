// Tasks under the virtual clock, and how they end: on their own, by an exception, a stop, an
// interrupt, a dead end.
// SPDX-License-Identifier: Apache-2.0
#include "devices/time/clock.h"

#include <gtest/gtest.h>

#include <atomic>
#include <csignal>
#include <functional>
#include <stdexcept>
#include <string>
#include <thread>
#include <unistd.h>

namespace vitreo {
namespace {

using namespace std::chrono_literals;

/// A task that does nothing but wait until it is stopped.
std::function<void()> wait_for(Clock& clock, Signal& never) {
  return [&clock, &never] {
    clock.wait(
        never, [] { return false; }, kForever);
  };
}

TEST(Task, KeepsAnExceptionOfItsBodyForJoin) {
  const auto clock = virtual_clock();
  const auto task = clock->spawn("task", [&] {
    clock->sleep_for(5s);
    throw std::out_of_range("far out");
  });
  try {
    task->join();
    FAIL() << "join() swallowed the exception";
  } catch (const std::out_of_range& error) {
    EXPECT_STREQ(error.what(), "far out");
  }
  EXPECT_EQ(clock->now(), 5s);
}

TEST(Task, CanJoinATaskOfItsOwn) {
  const auto clock = virtual_clock();
  std::string trace;
  const auto parent = clock->spawn("parent", [&] {
    const auto child = clock->spawn("child", [&] {
      clock->sleep_for(2s);
      trace += "child ";
    });
    child->join();
    trace += "parent";
  });
  parent->join();
  EXPECT_EQ(trace, "child parent");
  EXPECT_EQ(clock->now(), 2s);
}

TEST(Task, IsStoppedInItsWaitAndInEveryLaterOne) {
  const auto clock = virtual_clock();
  int stops = 0;
  const auto task = clock->spawn("task", [&] {
    for (int i = 0; i < 3; ++i) {
      try {
        clock->sleep_for(1h);
      } catch (const Stopped&) {
        ++stops;
      }
    }
  });
  clock->sleep_for(1s);
  task->request_stop();
  task->join();
  EXPECT_EQ(stops, 3);
  EXPECT_EQ(clock->now(), 1s);
}

TEST(Task, StopsItsWaitEvenWhenTheConditionHoldsAtLast) {
  const auto clock = virtual_clock();
  Signal signal;
  bool ready = false, stopped = false;
  const auto task = clock->spawn("task", [&] {
    try {
      clock->wait(
          signal, [&] { return ready; }, kForever);
    } catch (const Stopped&) {
      stopped = true;
    }
  });
  clock->sleep_for(1s);
  ready = true;
  clock->notify(signal);
  task->request_stop();
  task->join();
  EXPECT_TRUE(stopped);
}

TEST(Task, IsStoppedAndJoinedByItsDestructor) {
  const auto clock = virtual_clock();
  Signal never;
  bool unwound = false;
  {
    const auto task = clock->spawn("task", [&] {
      try {
        clock->wait(
            never, [] { return false; }, kForever);
      } catch (const Stopped&) {
        unwound = true;
        throw std::runtime_error("nobody asks for this");
      }
    });
    clock->sleep_for(1s);
  }
  EXPECT_TRUE(unwound);
}

TEST(Task, TakesItsChildrenWithIt) {
  const auto clock = virtual_clock();
  Signal never;
  std::string trace;
  {
    const auto parent = clock->spawn("parent", [&] {
      const auto child = clock->spawn("child", [&] {
        try {
          clock->wait(
              never, [] { return false; }, kForever);
        } catch (const Stopped&) {
          trace += "child ";
        }
      });
      try {
        clock->sleep_for(1h);
      } catch (const Stopped&) {
        trace += "parent ";
      }
    });
    clock->sleep_for(1s);
  }
  EXPECT_EQ(trace, "parent child ");
}

TEST(Interrupt, BreaksTheMainTasksNextWaitOnce) {
  const auto clock = virtual_clock();
  clock->interrupt();
  EXPECT_THROW(clock->sleep_for(1s), Stopped);
  clock->sleep_for(1s);
  EXPECT_EQ(clock->now(), 1s);
}

TEST(Interrupt, ReachesAMainTaskThatWaitsFarAheadWhileOthersRun) {
  const auto clock = virtual_clock();
  int ticks = 0;
  const auto ticker = clock->spawn("ticker", [&] {
    for (;; clock->sleep_for(1ms))
      if (++ticks == 100) clock->interrupt();
  });
  EXPECT_THROW(clock->sleep_for(1000h), Stopped);
  EXPECT_EQ(ticks, 100);
  EXPECT_EQ(clock->now(), 99ms);
}

TEST(Interrupt, DoesNotKeepTheMainTaskFromJoiningWhatItDestroys) {
  const auto clock = virtual_clock();
  bool cleaned = false;
  {
    const auto task = clock->spawn("task", [&] {
      try {
        clock->sleep_for(1h);
      } catch (const Stopped&) {
        cleaned = true;
      }
    });
    clock->sleep_for(1s);
    clock->interrupt();
  }
  EXPECT_TRUE(cleaned);
  EXPECT_THROW(clock->sleep_for(1s), Stopped);
}

Clock* signaled_clock = nullptr;
std::atomic<bool> signal_handled{false};
extern "C" void interrupt_signaled_clock(int) {
  signaled_clock->interrupt();
  signal_handled = true;
}

TEST(Interrupt, MayComeFromASignalHandler) {
  const auto clock = virtual_clock();
  signal_handled = false;
  signaled_clock = clock.get();
  const auto before = std::signal(SIGUSR1, interrupt_signaled_clock);
  const auto task = clock->spawn("task", [&] {
    clock->sleep_for(1s);
    // to the process: a task's own thread is deaf to signals, so the main one takes it
    kill(getpid(), SIGUSR1);
    while (!signal_handled) std::this_thread::yield();
    clock->sleep_for(10h);
  });
  EXPECT_THROW(clock->sleep_for(5h), Stopped);
  EXPECT_EQ(clock->now(), 1s);
  std::signal(SIGUSR1, before);
}

TEST(Deadlock, IsAnErrorOfTheMainTaskThatNamesWhoWaits) {
  const auto clock = virtual_clock();
  Signal never;
  const auto servo = clock->spawn("servo", wait_for(*clock, never));
  const auto camera = clock->spawn("camera", wait_for(*clock, never));
  for (int i = 0; i < 2; ++i) {
    try {
      servo->join();
      FAIL() << "no error";
    } catch (const std::logic_error& error) {
      EXPECT_NE(std::string(error.what()).find("camera, main, servo"), std::string::npos)
          << error.what();
    }
  }
  clock->sleep_for(1s);  // the clock itself is still good
  EXPECT_EQ(clock->now(), 1s);
}

TEST(Deadlock, GivesWayToAnInterrupt) {
  const auto clock = virtual_clock();
  Signal never;
  const auto task = clock->spawn("task", [&] {
    clock->interrupt();
    clock->wait(
        never, [] { return false; }, kForever);
  });
  EXPECT_THROW(task->join(), Stopped);
}

}  // namespace
}  // namespace vitreo
