// Sweeps: a table of 10 000 points read, written and drawn; plans, claims and marks a point.
// SPDX-License-Identifier: Apache-2.0
#include "host/trials/point_folder.h"
#include "host/trials/point_runner.h"
#include "host/trials/sweep_report.h"
#include "host/trials/sweep_table.h"

#include <benchmark/benchmark.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <string>

namespace vitreo {
namespace {

namespace fs = std::filesystem;

/// A new folder; it goes with the scope.
class Place {
 public:
  Place() {
    std::string name = (fs::temp_directory_path() / "vitreo_sweep_bench_XXXXXX").string();
    folder_ = mkdtemp(name.data());
  }
  ~Place() { fs::remove_all(folder_); }
  Place(const Place&) = delete;
  Place& operator=(const Place&) = delete;
  fs::path sweep() const { return folder_ / "sweep"; }

 private:
  fs::path folder_;
};

nlohmann::json axis(const std::string& name, const std::string& unit, int values, double step) {
  nlohmann::json made = {{"name", name}, {"unit", unit}, {"kind", "number"}, {"varied", true}};
  for (int i = 1; i <= values; ++i) made["values"].push_back(step * i);
  return made;
}

/// speeds x fields x 4 repeats.
PointPlan plan_of(int speeds, int fields) {
  PointPlan plan{{{"kind", "sweep"},
                  {"protocol", {{"name", "hold"}, {"title", "Hold and square"}}},
                  {"rig", {{"name", "simulated"}}},
                  {"repeats", 4},
                  {"seeds", "fresh"},
                  {"axes", {axis("speed", "m/s", speeds, 1e-5), axis("field", "T", fields, 1e-3)}}},
                 {}};
  for (int speed = 1; speed <= speeds; ++speed)
    for (int field = 1; field <= fields; ++field)
      for (int repeat = 1; repeat <= 4; ++repeat) {
        const nlohmann::json what = {
            {"setting", speed * fields + field},
            {"repeat", repeat},
            {"seed", plan.points.size() + 1},
            {"values", {{"speed", 1e-5 * speed}, {"field", 1e-3 * field}}}};
        plan.points.push_back({point_key(what), what});
      }
  return plan;
}

nlohmann::json result_of(std::size_t point) {
  nlohmann::json results = nlohmann::json::array();
  for (int i = 0; i < 8; ++i)
    results.push_back({{"name", "result_" + std::to_string(i)},
                       {"value", 1e-4 * (2 + std::sin(0.01 * static_cast<double>(point) + i))},
                       {"unit", "m"}});
  return {{"outcome", point % 97 == 0 ? "failed" : "completed"},
          {"exit_code", 0},
          {"reason", ""},
          {"run", "2026-11-24T150000_hold_0000"},
          {"wall_time", 5.0},
          {"results", results}};
}

void TableOfTenThousandPointsReadAndDrawn(benchmark::State& state) {
  const Place place;
  const PointFolder made = PointFolder::create(place.sweep(), plan_of(50, 50));
  for (std::size_t point = 0; point < made.points().size(); ++point)
    made.mark(point, result_of(point));
  for (auto _ : state) {
    const PointFolder folder(place.sweep());
    const SweepTable table = read_table(folder);
    write_tables(table, folder);
    write_sweep_report(table, folder, "");
    state.counters["points"] = static_cast<double>(table.rows.size());
  }
}
BENCHMARK(TableOfTenThousandPointsReadAndDrawn)->Unit(benchmark::kMillisecond)->Iterations(3);

void PlanWritten(benchmark::State& state) {
  const PointPlan plan = plan_of(static_cast<int>(state.range(0)), 25);
  for (auto _ : state) {
    const Place place;
    PointFolder::create(place.sweep(), plan);
  }
  state.counters["points"] = static_cast<double>(plan.points.size());
}
BENCHMARK(PlanWritten)->Arg(100)->Arg(1000)->Unit(benchmark::kMillisecond);

void PlanRead(benchmark::State& state) {
  const Place place;
  PointFolder::create(place.sweep(), plan_of(static_cast<int>(state.range(0)), 25));
  for (auto _ : state) {
    const PointFolder folder(place.sweep());
    benchmark::DoNotOptimize(folder.points().data());
  }
}
BENCHMARK(PlanRead)->Arg(100)->Arg(1000)->Unit(benchmark::kMillisecond);

void UnfinishedPointsListed(benchmark::State& state) {
  const Place place;
  const PointFolder folder = PointFolder::create(place.sweep(), plan_of(100, 25));
  for (std::size_t point = 0; point < folder.points().size(); point += 2)
    folder.mark(point, {{"outcome", "completed"}});
  for (auto _ : state) benchmark::DoNotOptimize(folder.unfinished().size());
}
BENCHMARK(UnfinishedPointsListed)->Unit(benchmark::kMillisecond)->Iterations(20);

/// What the engine itself costs: points that do nothing, each forked, claimed and marked.
void PointsThatDoNothing(benchmark::State& state) {
  const PointPlan plan = plan_of(10, 10);
  for (auto _ : state) {
    const Place place;
    const PointFolder folder = PointFolder::create(place.sweep(), plan);
    RunnerOptions options;
    options.jobs = static_cast<int>(state.range(0));
    run_points(
        folder,
        [](const PlannedPoint&, std::size_t, const SayLine&) {
          return nlohmann::json{{"outcome", "completed"}};
        },
        options);
  }
  state.SetItemsProcessed(state.iterations() * 400);
}
BENCHMARK(PointsThatDoNothing)
    ->Arg(1)
    ->Arg(2)
    ->Unit(benchmark::kMillisecond)
    ->Iterations(2)
    ->UseRealTime();

}  // namespace
}  // namespace vitreo
