// Bench of focus, autofocus and mosaic.
// SPDX-License-Identifier: Apache-2.0
#include "tests/vision/focus_stack.h"
#include "tests/vision/retina.h"
#include "vision/autofocus.h"
#include "vision/focus.h"
#include "vision/mosaic.h"

#include <benchmark/benchmark.h>

#include <random>
#include <string>

namespace {

using namespace vitreo::vision;

const cv::Mat& frame() {
  static const cv::Mat image = [] {
    synthetic::Scene scene;
    std::mt19937_64 random(1);
    return synthetic::noisy(synthetic::ground_of(scene), scene, random);
  }();
  return image;
}

// A window of 128 x 128 px, to and fro by (4, 3) px within its margin.
void slide(benchmark::State& state, FocusMeasure measure) {
  FocusWindow window(measure, {128, 128});
  window.look(frame(), {320, 240});
  bool there = false;
  for (auto _ : state) {
    there = !there;
    benchmark::DoNotOptimize(window.move(there ? cv::Point(324, 243) : cv::Point(320, 240)));
  }
}

void look(benchmark::State& state, FocusMeasure measure) {
  FocusWindow window(measure, {128, 128}, 0);
  window.look(frame(), {320, 240});
  for (auto _ : state) benchmark::DoNotOptimize(window.look(frame(), {320, 240}));
}

void whole(benchmark::State& state, FocusMeasure measure) {
  FocusWindow window(measure, frame().size(), 0);
  window.look(frame(), {320, 240});
  for (auto _ : state) benchmark::DoNotOptimize(window.look(frame(), {320, 240}));
}

const bool kRegistered = [] {
  for (const FocusMeasure measure : focus_measures()) {
    const std::string name(name_of(measure));
    benchmark::RegisterBenchmark(("vision/focus_slide_128/" + name).c_str(), slide, measure);
    benchmark::RegisterBenchmark(("vision/focus_look_128/" + name).c_str(), look, measure);
    benchmark::RegisterBenchmark(("vision/focus_look_640x480/" + name).c_str(), whole, measure);
  }
  return true;
}();

void peak(benchmark::State& state) {
  const auto samples = synthetic::curve_of(synthetic::images_of({}),
                                           FocusMeasure::smoothed_tenengrad, {60, 60, 80, 80});
  for (auto _ : state) benchmark::DoNotOptimize(find_focus_peak(samples));
}
BENCHMARK(peak)->Name("vision/focus_peak_31_steps");

std::pair<cv::Mat, cv::Mat> two_views() {
  const cv::Mat retina = synthetic::retina({1500, 1200}, 11);
  std::mt19937_64 random(1);
  return {synthetic::view_of(retina, synthetic::picture_from_view({700, 600}, 0), {}, random),
          synthetic::view_of(retina, synthetic::picture_from_view({900, 640}, 0.3), {}, random)};
}

void registration(benchmark::State& state) {
  const auto [first, second] = two_views();
  const RegistrationSettings settings;
  for (auto _ : state) {
    const RegistrationView a(first, settings), b(second, settings);
    benchmark::DoNotOptimize(register_views(a, b, settings));
  }
}
BENCHMARK(registration)->Name("vision/register_two_views")->Unit(benchmark::kMillisecond);

void mosaic(benchmark::State& state) {
  const auto [first, second] = two_views();
  const std::vector<cv::Mat> views{first, second};
  for (auto _ : state) benchmark::DoNotOptimize(blend_mosaic(views, plan_mosaic(views)));
}
BENCHMARK(mosaic)->Name("vision/mosaic_of_two")->Unit(benchmark::kMillisecond);

}  // namespace
