// A loop of 100 Hz on the wall clock: how late its turns come beside nothing, beside a script that
// computes alone, and beside one of short calls into the host; the three in turns, so that the
// machine's own lateness is in all alike. Beside them a thread that only sleeps.
// SPDX-License-Identifier: Apache-2.0
#include "devices/time/clock.h"
#include "devices/time/turn_sharing.h"

#include <benchmark/benchmark.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <memory>
#include <string>
#include <thread>
#include <vector>

namespace vitreo {
namespace {

using namespace std::chrono_literals;
using Steady = std::chrono::steady_clock;

constexpr Time kPeriod = 10ms;
constexpr Time kRound = 2s;
constexpr int kRounds = 5;

void compute_for(Time duration) {
  for (const auto until = Steady::now() + duration; Steady::now() < until;) continue;
}

void compute_alone(Clock& clock) {
  turn_sharing(clock)->begin_alone();
  compute_for(kRound);
  turn_sharing(clock)->end_alone();
}

void call_again_and_again(Clock& clock) {
  for (const auto until = Steady::now() + kRound; Steady::now() < until;) {
    turn_sharing(clock)->begin_alone();
    compute_for(100us);
    turn_sharing(clock)->end_alone();
  }
}

/// ms by which a thread that sleeps for `kPeriod` wakes late.
std::vector<double> machine_lateness() {
  std::vector<double> late;
  for (const auto end = Steady::now() + kRound; Steady::now() < end;) {
    const auto due = Steady::now() + kPeriod;
    std::this_thread::sleep_until(due);
    late.push_back(std::chrono::duration<double, std::milli>(Steady::now() - due).count());
  }
  return late;
}

/// ms by which the turns of a loop came late while `script` ran.
std::vector<double> lateness_beside(void (*script)(Clock&)) {
  const auto clock = wall_clock();
  std::vector<double> late;
  const auto loop = clock->spawn("loop", [&late, &clock] {
    for (Time due = clock->now() + kPeriod;; due += kPeriod) {
      clock->sleep_until(due);
      late.push_back(to_seconds(clock->now() - due) * 1e3);
    }
  });
  clock->sleep_for(20ms);
  script(*clock);
  clock->sleep_for(20ms);
  return late;
}

void count(benchmark::State& state, const std::string& name, std::vector<double>& late) {
  std::sort(late.begin(), late.end());
  const auto part = [&late](double of) {
    return late[static_cast<std::size_t>(of * static_cast<double>(late.size() - 1))];
  };
  state.counters[name + " median ms"] = part(0.5);
  state.counters[name + " p99 ms"] = part(0.99);
  state.counters[name + " worst ms"] = late.back();
}

void LoopBesideAScript(benchmark::State& state) {
  std::array<std::vector<double>, 4> late;
  const std::array<void (*)(Clock&), 3> scripts{[](Clock& clock) { clock.sleep_for(kRound); },
                                                compute_alone, call_again_and_again};
  for (auto _ : state)
    for (int round = 0; round < kRounds; ++round) {
      for (std::size_t kind = 0; kind < scripts.size(); ++kind) {
        const std::vector<double> more = lateness_beside(scripts[kind]);
        late[kind].insert(late[kind].end(), more.begin(), more.end());
      }
      const std::vector<double> more = machine_lateness();
      late[3].insert(late[3].end(), more.begin(), more.end());
    }
  const std::array<std::string, 4> names{"rest", "alone", "calls", "machine"};
  for (std::size_t kind = 0; kind < names.size(); ++kind) count(state, names[kind], late[kind]);
}
BENCHMARK(LoopBesideAScript)->Iterations(1)->Unit(benchmark::kSecond);

}  // namespace
}  // namespace vitreo
