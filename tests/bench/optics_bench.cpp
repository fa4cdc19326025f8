// SPDX-License-Identifier: Apache-2.0
#include "optics/analysis/field_errors.h"
#include "optics/analysis/wavefront.h"
#include "optics/design/lens_design.h"
#include "optics/maps/thesis_curves.h"
#include "optics/pose/object_pose.h"
#include "optics/pose/pose.h"
#include "optics/rays/batch.h"
#include "optics/system/frames.h"
#include "optics/system/prescriptions.h"

#include <benchmark/benchmark.h>

#include <numbers>
#include <random>
#include <string>
#include <vector>

namespace {

using namespace vitreo::optics;

/// Navarro's eye with the condensing lens of tables 3.3 and 3.4: seven surfaces, six of which
/// refract.
System table_3_4() {
  constexpr double kMm = 1e-3;
  const double rows[7][4] = {{12.00, 0.00, 16.32, 1.336},  {6.00, -1.00, 4.00, 1.420},
                             {-10.20, -3.13, 3.05, 1.337}, {-6.50, 0.00, 0.55, 1.376},
                             {-7.72, -0.26, 2.31, 1.000},  {11.65, -9.24, 13.00, 1.523},
                             {-9.48, -1.07, 0.00, 1.000}};
  System system;
  for (const auto& row : rows) {
    Surface surface;
    surface.radius = row[0] * kMm, surface.conic = row[1], surface.thickness = row[2] * kMm,
    surface.index = row[3];
    system.surfaces.push_back(surface);
  }
  system.surfaces[5].aspheric = {4.078e-5 * 1e9, -1.542e-7 * 1e15, -2.647e-9 * 1e21,
                                 2.023e-11 * 1e27};
  system.stop = Stop{3, 1.5 * kMm};
  return system;
}

/// Skew rays of a retinal point 20 degrees off the axis that come through the stop, as the peers
/// were measured with.
std::vector<Ray> skew_rays(const System& system, int count) {
  const PupilTracer tracer(system, Pupil::of_stop(system));
  const Eigen::Vector3d object = *point_at_field(system, 20 * std::numbers::pi / 180);
  const Ray chief = *tracer.aim(object);
  std::mt19937 generator(1);
  std::uniform_real_distribution<double> uniform(-0.06, 0.06);
  std::vector<Ray> rays;
  while (static_cast<int>(rays.size()) < count) {
    const Ray ray{object,
                  (chief.direction + Eigen::Vector3d(uniform(generator), uniform(generator), 0))
                      .normalized()};
    if (trace_out(system, ray).status == TraceStatus::ok) rays.push_back(ray);
  }
  return rays;
}

/// Counts refractions only: the peers' numbers have the image plane besides, a seventh.
void count_ray_surfaces(benchmark::State& state, const System& system, int rays) {
  const double each = static_cast<double>(rays) * (system.size() - 1);
  state.counters["ray_surfaces_per_second"] = benchmark::Counter(
      each * static_cast<double>(state.iterations()), benchmark::Counter::kIsRate);
}

void trace_batch(benchmark::State& state, CpuLevel level) {
  constexpr int kRays = 4096;
  const System system = table_3_4();
  const BatchTracer tracer(system, level);
  const std::vector<Ray> rays = skew_rays(system, kRays);
  RayBatch start(kRays);
  for (int i = 0; i < kRays; ++i) start.put(i, rays[i]);
  RayBatch batch = start;
  for (auto _ : state) {
    batch = start;  // the copy is part of the time
    tracer.trace_out(batch);
    benchmark::DoNotOptimize(batch.blocks().data());
    benchmark::ClobberMemory();
  }
  count_ray_surfaces(state, system, kRays);
}
const bool kRegistered = [] {
  for (const CpuLevel level : cpu_levels()) {
    benchmark::RegisterBenchmark(("optics/trace_batch/" + std::string(to_string(level))).c_str(),
                                 trace_batch, level);
  }
  return true;
}();

// Each thread its own rays: what two of them make beside one.
void trace_batch_threads(benchmark::State& state) { trace_batch(state, best_cpu_level()); }
BENCHMARK(trace_batch_threads)
    ->Name("optics/trace_batch_threads")
    ->Threads(1)
    ->Threads(2)
    ->UseRealTime();

/// 0: centered; 1: the lens of the eye off the axis; 2: all surfaces; 3: Liou and Brennan's
/// gradient lens.
System skew_system(int kind) {
  System system = kind == 3 ? prescription("liou_brennan_condensing").system : table_3_4();
  const Placement motion{{1e-4, 0, 0}, {0, 0.02, 0}};
  if (kind == 1 || kind == 2)
    place_group(system, 2, kind == 1 ? 3 : system.size(), motion, {0, 0, system.vertex(3)});
  return system;
}

void trace_batch_skew(benchmark::State& state) {
  constexpr int kRays = 1024;
  const System system = skew_system(static_cast<int>(state.range(0)));
  const BatchTracer tracer(system);
  const std::vector<Ray> rays = skew_rays(system, kRays);
  RayBatch start(kRays);
  for (int i = 0; i < kRays; ++i) start.put(i, rays[i]);
  RayBatch batch = start;
  for (auto _ : state) {
    batch = start;
    tracer.trace_out(batch);
    benchmark::DoNotOptimize(batch.blocks().data());
    benchmark::ClobberMemory();
  }
  count_ray_surfaces(state, system, kRays);
}
BENCHMARK(trace_batch_skew)->Name("optics/trace_batch_skew")->DenseRange(0, 3);

void wave_of_point(benchmark::State& state) {
  const System system = table_3_4();
  const PupilTracer tracer(system, Pupil::of_stop(system, Pupil::Kind::real_stop));
  for (auto _ : state) benchmark::DoNotOptimize(wavefront(tracer, {0, 0, 0}));
}
BENCHMARK(wave_of_point)->Name("optics/wavefront")->Unit(benchmark::kMillisecond);

void trace_scalar(benchmark::State& state) {
  constexpr int kRays = 256;
  const System system = table_3_4();
  const std::vector<Ray> rays = skew_rays(system, kRays);
  for (auto _ : state) {
    for (const Ray& ray : rays) benchmark::DoNotOptimize(trace_out(system, ray));
  }
  count_ray_surfaces(state, system, kRays);
}
BENCHMARK(trace_scalar)->Name("optics/trace_scalar");

// A whole map, with the thesis' isofocus surfaces and isopixel curves fitted to it.
void map(benchmark::State& state) {
  const System system = table_3_4();
  for (auto _ : state) {
    const WideAngleMap made(system);
    benchmark::DoNotOptimize(fit_thesis_curves(made));
  }
}
BENCHMARK(map)->Name("optics/map")->Unit(benchmark::kMillisecond);

void map_point(benchmark::State& state) {
  const WideAngleMap made(table_3_4());
  AerialPoint aerial{{-2e-3, 3e-3}, 9e-3};
  for (auto _ : state) {
    benchmark::DoNotOptimize(aerial);
    benchmark::DoNotOptimize(made.point(aerial));
  }
}
BENCHMARK(map_point)->Name("optics/map_inverse");

/// A bare sensor's, a finite-pupil microscope's, and a tilted and decentered one's.
void map_of_observer(benchmark::State& state) {
  WideAngleSettings settings;
  settings.max_angle = 30 * std::numbers::pi / 180;
  settings.microscope = Microscope{};
  settings.microscope->pupil_distance = 0.15;
  if (state.range(0) != 0)
    settings.microscope->tilt = {0.03, 0.01}, settings.microscope->decenter = {0.5e-3, 0};
  const System system = model_eye_5_3();
  for (auto _ : state) benchmark::DoNotOptimize(WideAngleMap(system, settings));
}
BENCHMARK(map_of_observer)
    ->Name("optics/map_of_microscope")
    ->Arg(0)
    ->Arg(1)
    ->Unit(benchmark::kMillisecond);

/// 24 eyes, each with its own map and curves, and what one who believes in the prescription gets
/// wrong in it.
void sensitivity_with_maps(benchmark::State& state) {
  const Prescription eye = prescription("navarro_condensing");
  auto uncertainties = table_5_1();
  uncertainties.push_back({"stop.radius", 0.1, "an arbitrary twelfth"});
  for (auto _ : state) {
    const EyeError error = field_error(eye);
    for (const Uncertainty& one : uncertainties) {
      for (const double sigmas : {-1.0, 1.0}) {
        const Prescription truth = perturbed(eye, one, sigmas);
        benchmark::DoNotOptimize(fit_thesis_curves(WideAngleMap(truth.system)));
        benchmark::DoNotOptimize(error(truth));
      }
    }
  }
}
BENCHMARK(sensitivity_with_maps)
    ->Name("optics/sensitivity_24_cases")
    ->Unit(benchmark::kMillisecond);

/// From spheres, six variables, four ways.
void lens_design(benchmark::State& state) {
  Prescription start = prescription("navarro_condensing");
  start.system.surfaces[5].conic = start.system.surfaces[6].conic = 0,
  start.system.surfaces[5].aspheric = {};
  LensDesignOptions options;
  for (const char* shape : {"posterior.conic", "posterior.a4", "posterior.a6", "posterior.a8",
                            "posterior.a10", "anterior.conic"}) {
    options.variables.push_back({std::string("condensing.") + shape});
  }
  for (auto _ : state) benchmark::DoNotOptimize(design_lens(start, options));
}
BENCHMARK(lens_design)->Name("optics/lens_design")->Unit(benchmark::kMillisecond);

/// With argument 1 the microscope is askew, and the table a grid.
void exact_projection(benchmark::State& state) {
  Microscope microscope;
  if (state.range(0) == 1) {
    microscope.pupil_distance = 0.15;
    microscope.tilt = {0.02, 0.01};
  }
  const ExactProjection exact(model_eye_5_3(), microscope, 7e-3);
  std::mt19937 generator(1);
  std::uniform_real_distribution<double> uniform(-1, 1);
  std::vector<Eigen::Vector3d> points;
  while (points.size() < 1024) {
    const Eigen::Vector3d p(5e-3 * uniform(generator), 5e-3 * uniform(generator),
                            4e-3 * (uniform(generator) + 1));
    if (exact.project(p)) points.push_back(p);
  }
  std::size_t i = 0;
  for (auto _ : state) benchmark::DoNotOptimize(exact.project(points[++i % points.size()]));
}
BENCHMARK(exact_projection)->Name("optics/exact_projection")->Arg(0)->Arg(1);

/// With argument 0 by the thesis' single viewpoint, with 1 by the exact projection, with 2 by that
/// and weighted.
void locate_robot(benchmark::State& state) {
  PoseSettings settings;
  settings.projection = fit_single_viewpoint(model_eye_5_3(), Microscope{}, 7e-3);
  settings.weighted = state.range(0) == 2;
  if (state.range(0) > 0) settings.exact.emplace(model_eye_5_3(), Microscope{}, 8e-3);
  const Eigen::Vector3d place(2e-3, 1e-3, 5e-3), axis = Eigen::Vector3d(1, 0.2, 0.3).normalized();
  EllipseVector seen = *project_spheroid(settings, place, axis);
  seen[2] += 0.2, seen[0] -= 0.1;  // px, as a tracker would
  const EllipseCovariance covariance = EllipseCovariance::Identity() * 0.04;
  const Eigen::Vector3d start = place + Eigen::Vector3d(5e-5, -5e-5, 1e-4);  // a frame ago
  for (auto _ : state) {
    benchmark::DoNotOptimize(seen);
    benchmark::DoNotOptimize(locate(settings, seen, covariance, axis, start));
  }
}
BENCHMARK(locate_robot)->Name("optics/locate")->Arg(0)->Arg(1)->Arg(2);

/// Bodies of all shapes by the exact projection, from the last frame's place; with argument 1 with
/// its uncertain orientation; 2 and 3 are the same without a place to start from.
void locate_body(benchmark::State& state, const ObjectModel& body) {
  ObjectPoseSettings settings;
  settings.exact.emplace(model_eye_5_3(), Microscope{}, 8e-3);
  settings.object = body;
  if (state.range(0) % 2 == 1) settings.orientation_sigma = 0.03;
  const BodyPose pose{{2e-3, 1e-3, 5e-3}, orientation_along({1, 0.2, 0.3})};
  EllipseVector seen = *project_object(settings, pose);
  seen[2] += 0.2, seen[0] -= 0.1;  // px, as a tracker would
  EllipseCovariance covariance = EllipseCovariance::Identity() * 0.04;
  covariance(4, 4) = 1e-5;
  PoseStart start{pose.position_in_eye + Eigen::Vector3d(5e-5, -5e-5, 1e-4), pose.orientation};
  if (state.range(0) >= 2) start.position_in_eye.reset();
  for (auto _ : state) benchmark::DoNotOptimize(locate_object(settings, seen, covariance, start));
}
BENCHMARK_CAPTURE(locate_body, ellipsoid, ellipsoid({0.5e-3, 0.5e-3, 1e-3}))
    ->Name("optics/locate_ellipsoid")
    ->DenseRange(0, 3);
BENCHMARK_CAPTURE(locate_body, cylinder, cylinder(1e-3, 0.25e-3))
    ->Name("optics/locate_cylinder")
    ->DenseRange(0, 3);

}  // namespace
