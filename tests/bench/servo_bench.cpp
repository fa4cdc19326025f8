// The chain frame -> currents and the simulator's rendering, as one run of the program does them,
// without the clock.
// SPDX-License-Identifier: Apache-2.0
#include "host/rig/open_rig.h"
#include "host/servo/localizer.h"
#include "host/servo/servo_controller.h"
#include "host/session/background.h"

#include <benchmark/benchmark.h>

#include <algorithm>
#include <chrono>
#include <vector>

namespace {

using namespace vitreo;

/// The frames of a robot that goes along x at mid-depth, as the default rig's camera has them.
struct Footage {
  vision::Background background;
  std::vector<Frame> frames;
  std::unique_ptr<Clock> clock = virtual_clock();
  std::unique_ptr<OpenRig> rig;
};

Footage record_footage(int count) {
  Footage footage;
  RigDescription description;
  description.file = "benchmark";
  for (const char* role : {"top_camera", "coils", "sample"})
    description.table[role] = ConfigValue{ConfigTable{}};
  footage.rig = open_rig(description, *footage.clock, 1);
  Rig& rig = footage.rig->rig();
  footage.background = learn_background(*rig.top_camera, 15, Time(0));
  for (int i = 0; i < count; ++i) {
    rig.sample->insert_robot({-3e-3 + 6e-3 * i / count, 0, 0});
    footage.clock->sleep_for(from_seconds(0.2));
    footage.frames.push_back(rig.top_camera->grab(kForever));
  }
  return footage;
}

double quantile(std::vector<double> values, double part) {
  std::sort(values.begin(), values.end());
  return values[static_cast<std::size_t>(part * static_cast<double>(values.size() - 1))];
}

void frame_to_currents(benchmark::State& state) {
  const Footage footage = record_footage(60);
  Localizer localizer(footage.rig->rig().model, footage.background, Eigen::Vector3d::UnitX());
  ControllerSettings settings;
  settings.law = ControlLaw::estimator;
  ServoController chain(footage.rig->rig().model, settings);
  std::vector<double> microseconds;
  double time = 0;
  std::size_t next = 0;
  for (auto _ : state) {
    const auto start = std::chrono::steady_clock::now();
    const Observation seen = localizer.look(footage.frames[next].image);
    std::optional<control::PositionMeasurement> measured;
    if (seen.position)
      measured = control::PositionMeasurement{time, *seen.position, seen.covariance};
    benchmark::DoNotOptimize(chain.step(time + 0.08, measured, {}, ControlMode::follow));
    microseconds.push_back(
        std::chrono::duration<double, std::micro>(std::chrono::steady_clock::now() - start)
            .count());
    next = (next + 1) % footage.frames.size();
    time += 1 / 15.0;
  }
  state.counters["median_us"] = quantile(microseconds, 0.5);
  state.counters["p99_us"] = quantile(microseconds, 0.99);
}
BENCHMARK(frame_to_currents)
    ->Name("loop/frame_to_currents")
    ->Iterations(2000)
    ->Unit(benchmark::kMicrosecond);

void render(benchmark::State& state, sim::ImageSize size) {
  optics::ImageScale scale;
  scale.center_px = {(size.width - 1) / 2.0, (size.height - 1) / 2.0};
  const optics::System eye = optics::model_eye_5_3();
  const Eigen::Vector3d eye_in_world(0, 0, -5e-3);
  sim::View view = sim::eye_view(eye, {}, scale, size, eye_in_world);
  const cv::Mat ground = sim::retina_ground(view, sim::Fundus::drawn(1, 18e-3), 11.5e-3);
  sim::Renderer renderer(std::move(view), {}, sim::eye_defocus(eye, {}, scale), ground, 3e-3, {},
                         {}, 1);
  std::uint64_t frame = 0;
  for (auto _ : state) {
    const double x = 1e-3 * std::sin(0.1 * static_cast<double>(frame));
    const sim::BodyState robot{{x, 0, 0}, Eigen::Vector3d::UnitX(), 1e-3, 0.5e-3};
    benchmark::DoNotOptimize(renderer.render(&robot, frame++));
  }
  state.counters["frames_per_second"] =
      benchmark::Counter(static_cast<double>(frame), benchmark::Counter::kIsRate);
}
BENCHMARK_CAPTURE(render, 640x480, sim::ImageSize{640, 480})
    ->Name("sim/render_640x480")
    ->Unit(benchmark::kMicrosecond);
BENCHMARK_CAPTURE(render, 1384x1036, sim::ImageSize{1384, 1036})
    ->Name("sim/render_1384x1036")
    ->Unit(benchmark::kMicrosecond);
BENCHMARK_CAPTURE(render, 128x128, sim::ImageSize{128, 128})
    ->Name("sim/render_128x128")
    ->Unit(benchmark::kMicrosecond);

/// Steps of 1 ms of the plant, without images. `discs`: of them on the retina besides the robot.
void world_step(benchmark::State& state, bool gel, int discs) {
  sim::WorldSettings settings;
  if (gel) {
    settings.robot = control::ndfeb_cylinder_1mm();
    settings.gel = control::artificial_vitreous(1);
  }
  for (int k = 0; k < discs; ++k) {
    sim::BodySettings disc;
    disc.name = "disc";
    disc.position = {(2.0 * k - 1) * 1e-3, 0, -4.7e-3};
    settings.bodies.push_back(disc);
  }
  sim::World world(settings, 1);
  world.insert_robot(Time(0), {0, 0, 0});
  world.set_coil_commands(Time(0), control::Currents::Constant(8, 1.5));
  std::int64_t step = 0;
  for (auto _ : state) benchmark::DoNotOptimize(world.robot(std::chrono::milliseconds(++step)));
}
BENCHMARK_CAPTURE(world_step, oil, false, 0)->Name("sim/world_step")->Unit(benchmark::kMicrosecond);
BENCHMARK_CAPTURE(world_step, gel, true, 0)
    ->Name("sim/world_step_gel")
    ->Unit(benchmark::kMicrosecond);
BENCHMARK_CAPTURE(world_step, two_discs, false, 2)
    ->Name("sim/world_step_two_discs")
    ->Unit(benchmark::kMicrosecond);

}  // namespace
