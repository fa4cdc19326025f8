// Bench of the script engine: a call into the host beyond a raw C call of Lua's (goal 1 us), a
// fresh state with all bindings (goal 1 ms), and the checks of a request's arguments before
// anything is opened (goal 10 ms).
// SPDX-License-Identifier: Apache-2.0
#include "host/engine/rehearsal.h"
#include "host/lua/engine/engine.h"
#include "host/lua/engine/library.h"
#include "host/lua/interpreter/state.h"
#include "tests/host/rig/fake_rig.h"

#include <benchmark/benchmark.h>

#include <fstream>

namespace vitreo {
namespace {

/// A session on a rig without instruments.
struct Bench {
  TemporaryFolder folder;
  SilentListener listener;
  std::unique_ptr<Clock> clock = virtual_clock();
  Rig rig;
  Recorder recorder{folder.path(), start_of_test(1)};
  Session session{*clock, rig, recorder, listener, 1};
  std::unique_ptr<ScriptEngine> engine = make_lua_engine({VITREO_SOURCE_DIR "/scripts"});

  std::string write(const std::string& body) {
    const std::string file = (folder.path() / "p.lua").string();
    std::ofstream(file)
        << "return { title = 'b', run = function(rig, p, run)\nlocal abs = math.abs\n"
        << body << "\nend }";
    return file;
  }
  /// s for `calls` of it.
  double time(const std::string& call, int calls) {
    const ProtocolDescription protocol =
        engine->describe(write("for i = 1, " + std::to_string(calls) + " do " + call + " end"));
    const auto began = std::chrono::steady_clock::now();
    engine->run(protocol, {}, session);
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - began).count();
  }
};

void engine_call(benchmark::State& state) {
  Bench bench;
  constexpr int kCalls = 1'000'000;
  double raw = 1e9, bound = 1e9;
  for (auto _ : state) {  // the least of each: the rest is other programs'
    raw = std::min(raw, bench.time("abs(-1.5)", kCalls) / kCalls);
    bound = std::min(bound, bench.time("run:now()", kCalls) / kCalls);
  }
  state.counters["raw_ns"] = raw * 1e9;
  state.counters["host_ns"] = bound * 1e9;
  state.counters["overhead_ns"] = (bound - raw) * 1e9;
}
BENCHMARK(engine_call)->Iterations(5)->Unit(benchmark::kMillisecond);

void engine_fresh_state(benchmark::State& state) {
  Bench bench;
  for (auto _ : state) {
    const lua::State fresh(lua::library(), &bench.session, {});
    benchmark::DoNotOptimize(&fresh);
  }
}
BENCHMARK(engine_fresh_state)->Unit(benchmark::kMicrosecond);

void engine_check_arguments(benchmark::State& state) {
  Bench bench;
  RunRequest request;
  request.what.protocol_file = VITREO_SOURCE_DIR "/protocols/servo_square.lua";
  request.where.rig_file = VITREO_SOURCE_DIR "/scripts/rigs/simulated.lua";
  request.what.arguments = {"speed=0.3mm/s"};
  for (auto _ : state) benchmark::DoNotOptimize(check_request(*bench.engine, request));
}
BENCHMARK(engine_check_arguments)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace vitreo
