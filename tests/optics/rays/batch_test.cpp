// Batch tracing against the scalar trace, ray by ray, at every CPU level of this machine.
// SPDX-License-Identifier: Apache-2.0
#include "optics/rays/batch.h"

#include "tests/optics/support.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <map>
#include <random>
#include <vector>

namespace vitreo::optics {
namespace VITREO_TEST_FILE {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

/// The systems that between them have every kind of surface and every way to lose a ray.
std::vector<System> systems() {
  std::vector<System> made{navarro_with_condensing_lens(false), navarro_with_condensing_lens(true),
                           model_eye_5_3()};
  System clipped = navarro_with_condensing_lens(true);
  clipped.surfaces[5].semi_diameter = 5 * kMm;
  clipped.stop->surface = 6;  // an aspheric surface with a stop
  clipped.stop->radius = 4 * kMm;
  made.push_back(clipped);
  made.push_back(one_surface(-8 * kMm, 0, 1.8, 1.0));      // total reflection and misses
  made.push_back(one_surface(-5 * kMm, -4, 1.4, 1.0));     // a hyperboloid: the wrong sheet
  made.push_back(one_surface(10 * kMm, -1, 1.336, 1.42));  // a paraboloid: the cancellation trap
  made.push_back(one_surface(std::numeric_limits<double>::infinity(), 0, 1.336, 1.0));
  System wavy = one_surface(std::numeric_limits<double>::infinity(), 0, 1.336,
                            1.5);  // an asphere without conic
  wavy.surfaces[1].aspheric = {1e5, -3e8, 0, 0};
  made.push_back(wavy);
  return made;
}

/// From everywhere in the vitreous to everywhere on surface 2 and far beside it; inwards from air.
std::vector<Ray> rays(const System& system, bool outwards, int count, unsigned seed) {
  std::mt19937 generator(seed);
  std::uniform_real_distribution<double> uniform(-1, 1);
  const double from = outwards ? 4 * kMm : system.vertex(system.size()) + 25 * kMm;
  const double to = outwards ? system.vertex(2) : system.vertex(system.size());
  std::vector<Ray> made;
  for (int i = 0; i < count; ++i) {
    const double wide = std::pow(10.0, uniform(generator));  // near-axial rays and wild ones
    const Eigen::Vector3d start(6 * kMm * uniform(generator), 6 * kMm * uniform(generator), from);
    const Eigen::Vector3d goal(wide * kMm * uniform(generator), wide * kMm * uniform(generator),
                               to);
    made.push_back({start, (goal - start).normalized()});
  }
  return made;
}

RayBatch batch_of(const std::vector<Ray>& rays) {
  RayBatch batch(static_cast<int>(rays.size()));
  for (int i = 0; i < batch.size(); ++i) batch.put(i, rays[i]);
  return batch;
}

TEST(Batch, AgreesWithTheScalarTraceRayByRay) {
  std::map<TraceStatus, int> seen;
  for (const System& system : systems()) {
    for (const bool outwards : {true, false}) {
      const std::vector<Ray> in = rays(system, outwards, 5000, 1);
      RayBatch batch = batch_of(in);
      const BatchTracer tracer(system);
      outwards ? tracer.trace_out(batch) : tracer.trace_in(batch);
      for (int i = 0; i < batch.size(); ++i) {
        const TraceResult scalar = outwards ? trace_out(system, in[i]) : trace_in(system, in[i]);
        const TraceResult found = batch.result(i);
        ++seen[scalar.status];
        ASSERT_EQ(found.status, scalar.status)
            << system.name << " ray " << i << ": " << to_string(found.status);
        ASSERT_EQ(found.surface, scalar.surface);
        // 1e-13 m is what the issue asks (1e-10 mm); the worst seen is 2e-15 m. Directions over 100
        // mm likewise.
        EXPECT_LT((found.ray.origin - scalar.ray.origin).norm(), 1e-13);
        EXPECT_LT((found.ray.direction - scalar.ray.direction).norm() * 0.1, 1e-13);
      }
    }
  }
  for (const TraceStatus status :
       {TraceStatus::ok, TraceStatus::missed, TraceStatus::total_reflection, TraceStatus::clipped,
        TraceStatus::wrong_sheet}) {
    EXPECT_GT(seen[status], 20) << to_string(status) << ": the test has too few of these";
  }
}

TEST(Batch, AllCpuLevelsGiveTheSameBits) {
  for (const System& system : systems()) {
    for (const bool outwards : {true, false}) {
      const std::vector<Ray> in = rays(system, outwards, 2000, 2);
      std::vector<RayBatch> out;
      for (const CpuLevel level : cpu_levels()) {
        out.push_back(batch_of(in));
        const BatchTracer tracer(system, level);
        outwards ? tracer.trace_out(out.back()) : tracer.trace_in(out.back());
      }
      for (std::size_t level = 1; level < out.size(); ++level) {
        for (std::size_t b = 0; b < out[0].blocks().size(); ++b) {
          EXPECT_EQ(std::memcmp(&out[0].blocks()[b], &out[level].blocks()[b], sizeof(RayBlock)), 0)
              << to_string(cpu_levels()[level]);
        }
      }
    }
  }
}

TEST(Batch, TheBestLevelIsTheLastOfThoseThatTheMachineHas) {
  ASSERT_FALSE(cpu_levels().empty());
  EXPECT_EQ(cpu_levels().front(), CpuLevel::baseline);
  EXPECT_EQ(cpu_levels().back(), best_cpu_level());
}

TEST(Batch, ALaneDoesNotDependOnItsNeighbors) {
  const System system = navarro_with_condensing_lens(true);
  const std::vector<Ray> in = rays(system, true, RayBlock::kSize, 3);
  RayBatch together = batch_of(in);
  const BatchTracer tracer(system);
  tracer.trace_out(together);
  for (int i = 0; i < RayBlock::kSize; ++i) {
    RayBatch alone = batch_of({in[i]});
    tracer.trace_out(alone);
    EXPECT_EQ(alone.result(0).ray.origin, together.result(i).ray.origin);
    EXPECT_EQ(alone.result(0).status, together.result(i).status);
  }
}

TEST(Batch, BadRaysAreLostAtTheFirstSurfaceAndSpoilNoOther) {
  const System system = navarro_with_condensing_lens(true);
  const Ray good{{0, 0, 4 * kMm}, {0, 0, 1}};
  const std::vector<Ray> bad = {{{kNan, 0, 0}, {0, 0, 1}},    {{0, 0, 0}, {0, kNan, 1}},
                                {{0, 0, 0}, {0, 0, -1}},      {{0, 0, 0}, {0, 0, 0}},
                                {{0, 0, 0}, {0, 0, 2}},       {{0, 0, 0}, {1, 0, 0}},
                                {{0, 0, 30 * kMm}, {0, 0, 1}}};  // beyond the lens already
  std::vector<Ray> in;
  for (const Ray& ray : bad) in.insert(in.end(), {ray, good});
  RayBatch batch = batch_of(in);
  BatchTracer(system).trace_out(batch);
  for (int i = 0; i < batch.size(); i += 2) {
    EXPECT_EQ(batch.result(i).status, TraceStatus::missed) << i;
    EXPECT_EQ(batch.result(i).surface, 2) << i;
    EXPECT_EQ(batch.result(i + 1).status, TraceStatus::ok) << i;
  }
}

TEST(Batch, RefusesBadArguments) {
  expect_refused("count", [] { RayBatch(-1); });
  System system = navarro_with_condensing_lens(true);
  system.stop.reset();
  RayBlock block{};
  expect_refused("stop", [&] { BatchTracer(system).trace_before_stop(block); });
  system.surfaces[2].index = 0.5;
  expect_refused("surface 3", [&] { BatchTracer tracer(system); });
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::optics
