// Cost of instruments written in Lua: a property over a link that takes no time, five of them
// polled at 1 kHz in all, and how late another task is beside one that computes all it may.
// SPDX-License-Identifier: Apache-2.0
#include "devices/links/dialogue.h"
#include "devices/scripted/instrument.h"

#include <benchmark/benchmark.h>

#include <algorithm>
#include <ctime>
#include <memory>
#include <string>
#include <vector>

namespace vitreo::scripted {
namespace {

using namespace std::chrono_literals;

/// Answers within the call.
class InstantLink final : public ByteLink {
 public:
  const std::string& address() const override { return address_; }
  void write(std::span<const std::uint8_t> bytes, Time) override {
    const std::string_view answer = bytes.front() == '*' ? "Maker,Model,1,2\n" : "+1.2345E+01\n";
    waiting_.assign(answer.begin(), answer.end());
  }
  ByteString read(std::size_t, Time) override { return std::exchange(waiting_, {}); }
  void reopen() override {}

 private:
  std::string address_ = "emulated";
  ByteString waiting_;
};

std::string file_of(const std::string& ask, double every) {
  return "return { title = 'A thermometer', kind = 'sensor', link = { timeout = 0.5 }, identity = "
         "'*IDN?', properties = { value = { ask = " +
         ask + ", every = " + std::to_string(every) + " } } }";
}

std::unique_ptr<Instrument> open(const std::string& ask, double every, Clock& clock) {
  const auto units = [](std::string_view) -> std::optional<DeclaredUnit> { return std::nullopt; };
  return open_instrument({load("bench.lua", file_of(ask, every), units),
                          std::make_unique<InstantLink>(), "thermometer", clock});
}

/// The link's own time: question and answer through the dialogue, in C++.
void BM_QuestionInCpp(benchmark::State& state) {
  const auto clock = wall_clock();
  Dialogue dialogue(std::make_unique<InstantLink>(), "thermometer", *clock);
  for (auto _ : state) {
    const Dialogue::Turn turn(dialogue);
    dialogue.discard();
    dialogue.send("T?\n");
    benchmark::DoNotOptimize(dialogue.line('\n', 4096, later(clock->now(), 500ms)));
  }
}
BENCHMARK(BM_QuestionInCpp);

void BM_Property(benchmark::State& state, const char* ask) {
  const auto clock = wall_clock();
  const auto instrument = open(ask, 0, *clock);
  for (auto _ : state) benchmark::DoNotOptimize(instrument->read(0, 1s));
}
BENCHMARK_CAPTURE(BM_Property, declared, "'T?'");
BENCHMARK_CAPTURE(BM_Property, function, "function(io) return tonumber(io:ask('T?')) end");
BENCHMARK_CAPTURE(
    BM_Property, function_with_pattern,
    "function(io) return tonumber(io:ask('T?'):match('^([+-]?%d+%.%d+E[+-]%d+)$')) end");

double processor_seconds() {
  timespec now{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + static_cast<double>(now.tv_nsec) * 1e-9;
}

/// Five instruments at 200 Hz each for a second: what part of a core they take.
void BM_FivePolledAt200Hz(benchmark::State& state, const char* ask) {
  double part = 0;
  int samples = 0;
  for (auto _ : state) {
    const auto clock = wall_clock();
    std::vector<std::unique_ptr<Instrument>> all;
    for (int i = 0; i < 5; ++i) {
      all.push_back(open(ask, 0.005, *clock));
      all.back()->on_poll([&samples](std::size_t, const Instrument::Latest&) { ++samples; });
    }
    samples = 0;
    const double began = processor_seconds();
    clock->sleep_for(1s);
    part += processor_seconds() - began;
  }
  state.counters["core"] = part / static_cast<double>(state.iterations());
  state.counters["samples"] = samples;
}
BENCHMARK_CAPTURE(BM_FivePolledAt200Hz, declared, "'T?'")->Iterations(3)->UseRealTime();
BENCHMARK_CAPTURE(BM_FivePolledAt200Hz, function, "function(io) return tonumber(io:ask('T?')) end")
    ->Iterations(3)
    ->UseRealTime();

/// A task that is due at 100 Hz, as a loop's is: how late it is, beside a driver that computes
/// nearly all that it may, 50 times a second.
void BM_LatenessOfALoop(benchmark::State& state, const char* ask) {
  std::vector<double> late;
  for (auto _ : state) {
    const auto clock = wall_clock();
    std::unique_ptr<Instrument> instrument;
    if (*ask != 0) instrument = open(ask, 0.02, *clock);
    Time due = clock->now();
    for (int i = 0; i < 300; ++i) {
      due = later(due, 10ms);
      clock->sleep_until(due);
      late.push_back(to_seconds(clock->now() - due) * 1e6);
    }
  }
  std::sort(late.begin(), late.end());
  state.counters["p50_us"] = late[late.size() / 2];
  state.counters["p99_us"] = late[late.size() * 99 / 100];
  state.counters["max_us"] = late.back();
}
BENCHMARK_CAPTURE(BM_LatenessOfALoop, alone, "")->Iterations(2)->UseRealTime();
BENCHMARK_CAPTURE(BM_LatenessOfALoop, beside_a_full_budget,
                  "function(io) for i = 1, 900000 do end return 5 end")
    ->Iterations(2)
    ->UseRealTime();

}  // namespace
}  // namespace vitreo::scripted
