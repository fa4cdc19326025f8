// Virtual clock: runs of several tasks against a plain event list, and the promises of the header.
// SPDX-License-Identifier: Apache-2.0
#include "devices/time/clock.h"

#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <limits>
#include <memory>
#include <random>
#include <stdexcept>
#include <string>
#include <thread>
#include <tuple>
#include <vector>

namespace vitreo {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;

struct Step {
  enum Kind { sleep, count_up, wait_for } kind = sleep;
  Time duration{0};  // of the sleep, or until the deadline
  int counter = 0;
  int goal = 0;
};
struct Program {
  std::string name;
  std::vector<Step> steps;
};
/// When, whose, which step, and what the wait returned.
using Entry = std::tuple<Time, std::string, int, bool>;
constexpr int kCounters = 3;
constexpr unsigned kSteps = 8;  // of each task

/// Random programs on a coarse grid of time, so that many are due together.
std::vector<Program> random_programs(std::uint64_t seed) {
  std::mt19937_64 random(seed);
  const auto upto = [&random](int n) { return static_cast<int>(random() % (n + 1)); };
  std::vector<Program> programs;
  for (const char* name : {"servo", "Camera", "lens", "10", "9", "main", "servo 2", "a"}) {
    Program program{name, {}};
    for (unsigned n = 0; n < kSteps; ++n) {
      Step step;
      step.kind = static_cast<Step::Kind>(upto(2));
      step.duration = upto(4) * 3ms + (step.kind == Step::wait_for ? 3ms : 0ms);
      step.counter = upto(kCounters - 1);
      step.goal = upto(25);
      program.steps.push_back(step);
    }
    programs.push_back(program);
  }
  return programs;
}

/// What the clock is to do, as a list of events: the task with the least (time, name, number) goes
/// on until it has to wait.
std::vector<Entry> expected(const std::vector<Program>& programs, Time start) {
  struct State {
    size_t step = 0;
    Time due{0};
    bool waits = false;
    bool ended = false;
  };
  std::vector<State> states(programs.size());
  for (State& state : states) state.due = start;
  std::vector<int> counters(kCounters, 0);
  std::vector<Entry> log;
  Time now = start;
  while (true) {
    size_t next = programs.size();
    for (size_t k = 0; k < programs.size(); ++k) {
      if (states[k].ended) continue;
      if (next == programs.size() || states[k].due < states[next].due ||
          (states[k].due == states[next].due && programs[k].name < programs[next].name))
        next = k;
    }
    if (next == programs.size()) return log;
    State& self = states[next];
    const Program& program = programs[next];
    now = self.due;
    const auto done = [&](bool result) {
      log.emplace_back(now, program.name, static_cast<int>(self.step++), result);
    };
    if (self.step > 0 || self.waits) {  // back from a sleep or a wait
      const Step& step = program.steps[self.step];
      done(step.kind != Step::wait_for || counters[step.counter] >= step.goal);
      self.waits = false;
    }
    for (; self.step < program.steps.size();) {
      const Step& step = program.steps[self.step];
      if (step.kind == Step::count_up) {
        ++counters[step.counter];
        for (size_t k = 0; k < programs.size(); ++k) {
          if (!states[k].waits) continue;
          const Step& other = programs[k].steps[states[k].step];
          if (other.kind == Step::wait_for && other.counter == step.counter &&
              counters[step.counter] >= other.goal)
            states[k].due = now;
        }
        done(true);
        continue;
      }
      if (step.kind == Step::wait_for && counters[step.counter] >= step.goal) {
        done(true);
        continue;
      }
      self.due = now + step.duration;
      self.waits = true;
      break;
    }
    self.ended = !self.waits;
  }
}

std::vector<Entry> really(const std::vector<Program>& programs, Clock& clock) {
  std::vector<Entry> log;
  std::vector<int> counters(kCounters, 0);
  std::vector<Signal> signals(kCounters);
  std::vector<std::unique_ptr<Task>> tasks;
  for (const Program& program : programs)
    tasks.push_back(clock.spawn(program.name, [&] {
      for (size_t n = 0; n < program.steps.size(); ++n) {
        const Step& step = program.steps[n];
        bool result = true;
        if (step.kind == Step::sleep) {
          clock.sleep_for(step.duration);
        } else if (step.kind == Step::count_up) {
          ++counters[step.counter];
          clock.notify(signals[step.counter]);
        } else {
          result = clock.wait(
              signals[step.counter], [&] { return counters[step.counter] >= step.goal; },
              clock.now() + step.duration);
        }
        log.emplace_back(clock.now(), program.name, static_cast<int>(n), result);
      }
    }));
  EXPECT_TRUE(log.empty()) << "a task began before its maker waited";
  for (const auto& task : tasks) task->join();
  return log;
}

TEST(VirtualClockReference, runs_of_many_tasks_are_those_of_an_event_list) {
  for (std::uint64_t seed = 1; seed <= 2; ++seed) {
    const auto clock = virtual_clock();
    clock->sleep_until(7ms + seed * 1ns);
    const std::vector<Program> programs = random_programs(seed);
    const std::vector<Entry> wanted = expected(programs, 7ms + seed * 1ns);
    ASSERT_EQ(wanted.size(), 8U * kSteps);
    EXPECT_EQ(really(programs, *clock), wanted) << seed;
  }
}

TEST(VirtualClockReference, at_the_pace_of_the_wall_clock_the_same_happens_and_takes_its_time) {
  const std::vector<Program> programs = random_programs(77);
  const std::vector<Entry> wanted = expected(programs, 1ms);
  const auto clock = virtual_clock(Pace::real_time);
  const auto begin = std::chrono::steady_clock::now();
  const double wall = wall_seconds();
  clock->sleep_until(1ms);
  EXPECT_EQ(really(programs, *clock), wanted);
  const auto took = std::chrono::steady_clock::now() - begin;
  const Time end = clock->now();
  EXPECT_EQ(end, std::get<0>(wanted.back()));
  EXPECT_GE(took, end - 5ms);
  EXPECT_LT(took, end + 5s);
  EXPECT_NEAR(wall_seconds() - wall, std::chrono::duration<double>(took).count(), 0.1);
}

TEST(VirtualClockReference, time_begins_at_zero_stands_while_a_task_computes_and_never_goes_back) {
  const auto clock = virtual_clock();
  EXPECT_EQ(clock->now(), 0ns);
  std::this_thread::sleep_for(3ms);
  clock->outside([] { std::this_thread::sleep_for(3ms); });
  EXPECT_EQ(clock->now(), 0ns);
  clock->sleep_until(123456789ns);
  EXPECT_EQ(clock->now(), 123456789ns);
  clock->sleep_until(5ns);
  clock->sleep_until(-1s);
  clock->sleep_for(-1s);
  EXPECT_EQ(clock->now(), 123456789ns);
  const auto begin = std::chrono::steady_clock::now();
  clock->sleep_for(200 * 24h);
  EXPECT_EQ(clock->now(), 123456789ns + 200 * 24h);
  EXPECT_LT(std::chrono::steady_clock::now() - begin, 1s);
  Signal signal;
  EXPECT_FALSE(clock->wait(
      signal, [] { return false; }, 3ns));
  EXPECT_TRUE(clock->wait(
      signal, [] { return true; }, 3ns));
  EXPECT_EQ(clock->now(), 123456789ns + 200 * 24h);
  EXPECT_EQ(clock->stuck_for(), 0ns);
}

TEST(VirtualClockReference, a_wait_until_a_moment_that_has_passed_gives_the_others_their_turn) {
  const auto clock = virtual_clock();
  clock->sleep_until(5ms);
  int turns = 0;
  const auto task = clock->spawn("a", [&] {
    ++turns;
    clock->sleep_for(1ns);
    ++turns;
  });
  EXPECT_EQ(turns, 0);
  clock->sleep_until(2ms);
  EXPECT_EQ(turns, 1);  // what is due a nanosecond later has none
  EXPECT_EQ(clock->now(), 5ms);
  task->join();
  EXPECT_EQ(turns, 2);
}

// Who asks for a moment that has passed lets those go first that are due and whose names come
// before; it keeps its turn against the others.
TEST(VirtualClockReference, who_lets_others_go_first_keeps_its_turn_by_its_name) {
  for (const bool first : {true, false}) {
    const auto clock = virtual_clock();
    std::string order;
    const auto asking = clock->spawn(first ? "a" : "c", [&] {
      order += "x";
      clock->sleep_until(0ns);
      order += "x";
    });
    const auto other = clock->spawn("b", [&] {
      order += "b";
      clock->sleep_until(0ns);
      order += "b";
    });
    asking->join();
    other->join();
    EXPECT_EQ(order, first ? "xxbb" : "bbxx");
  }
}

TEST(VirtualClockReference,
     ready_is_evaluated_at_the_start_and_at_each_notification_of_its_signal) {
  const auto clock = virtual_clock();
  Signal signal;
  Signal other;
  int asked = 0;
  int notified = 0;
  bool enough = false;
  const auto task = clock->spawn("n", [&] {
    for (int n = 0; n < 4; ++n) {
      clock->sleep_for(2ms);
      ++notified;
      enough = n == 3;
      clock->notify(other);
      if (n != 1) clock->notify(signal);
    }
    clock->sleep_for(50ms);
  });
  std::vector<int> when;
  EXPECT_TRUE(clock->wait(
      signal,
      [&] {
        ++asked;
        if (when.empty() || when.back() != notified) when.push_back(notified);
        return enough;
      },
      1s));
  EXPECT_EQ(clock->now(), 8ms);
  EXPECT_EQ(when, (std::vector<int>{0, 1, 3, 4}));
  // What becomes true and is not notified is seen at the deadline, not before.
  bool late = false;
  const auto quiet = clock->spawn("q", [&] {
    clock->sleep_for(1ms);
    late = true;
  });
  EXPECT_TRUE(clock->wait(
      signal, [&] { return late; }, 20ms));
  EXPECT_EQ(clock->now(), 20ms);
  quiet->join();
}

TEST(VirtualClockReference, one_notification_wakes_all_who_wait_in_the_order_of_their_names) {
  const auto clock = virtual_clock();
  Signal signal;
  bool open = false;
  std::string order;
  std::vector<std::unique_ptr<Task>> tasks;
  for (const char* name : {"d", "b", "x", "a"})
    tasks.push_back(clock->spawn(name, [&, name] {
      EXPECT_TRUE(clock->wait(
          signal, [&] { return open; }, kForever));
      order += name;
      EXPECT_EQ(clock->now(), 4ms);
    }));
  clock->sleep_until(4ms);
  open = true;
  clock->notify(signal);
  EXPECT_EQ(order, "");  // nobody runs beside who notifies
  clock->sleep_until(4ms);
  EXPECT_EQ(order, "abd");  // "x" comes after "main"
  for (const auto& task : tasks) task->join();
  EXPECT_EQ(order, "abdx");
}

TEST(VirtualClockReference, times_and_seconds_are_the_same_in_both_directions) {
  EXPECT_EQ(from_seconds(1.25), 1250ms);
  EXPECT_EQ(from_seconds(-0.0625), -62500us);
  EXPECT_EQ(from_seconds(0), 0ns);
  EXPECT_DOUBLE_EQ(to_seconds(1234567891ns), 1.234567891);
  std::mt19937_64 random(5);
  for (int n = 0; n < 1000; ++n) {
    const Time time{static_cast<std::int64_t>(random() % 1000000000000ULL)};
    EXPECT_LE(std::abs((from_seconds(to_seconds(time)) - time).count()), 1) << time.count();
  }
  EXPECT_EQ(from_seconds(9e9), 9000000000s);
  for (const double bad : {std::nan(""), std::numeric_limits<double>::infinity(),
                           -std::numeric_limits<double>::infinity(), 9.3e9, -9.3e9, 1e300})
    EXPECT_THROW(from_seconds(bad), std::invalid_argument) << bad;
  EXPECT_EQ(later(3ns, 4ns), 7ns);
  EXPECT_EQ(later(kForever - 4ns, 4ns), kForever);
  EXPECT_EQ(later(kForever - 4ns, 5ns), kForever);
  EXPECT_EQ(later(kForever - 5ns, 4ns), kForever - 1ns);
  EXPECT_EQ(later(5ns, kForever), kForever);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
