// SPDX-License-Identifier: Apache-2.0
#include "tests/vision/synthetic.h"
#include "vision/blob_tracker.h"
#include "vision/draw.h"

#include <benchmark/benchmark.h>

#include <random>

namespace {

using namespace vitreo::vision;

// The top camera's image with the 2 mm robot in its middle.
struct TopCamera {
  synthetic::Scene scene;
  cv::Mat empty, image;
  Background background;
  Ellipse truth{{690.3, 520.7}, 70, 35, 0.3};

  TopCamera() {
    scene.size = {1384, 1036};
    std::mt19937_64 random(1);
    const cv::Mat ground = synthetic::ground_of(scene);
    background = synthetic::learnt(ground, scene, random, 4);
    empty = synthetic::noisy(ground, scene, random);
    cv::Mat mean = ground.clone();
    synthetic::Look look;
    look.ambient = 15, look.diffuse = 41, look.specular = 89;
    synthetic::draw_body(mean, truth, look, scene);
    image = synthetic::noisy(mean, scene, random);
  }
};

const TopCamera& top_camera() {
  static const TopCamera camera;
  return camera;
}

void near_last_place(benchmark::State& state) {
  BlobTracker tracker(top_camera().background, {});
  tracker.update(top_camera().image);
  for (auto _ : state) benchmark::DoNotOptimize(tracker.update(top_camera().image));
}
BENCHMARK(near_last_place)->Name("vision/tracker_near_last_place");

void whole_image(benchmark::State& state) {
  BlobTracker tracker(top_camera().background, {});
  for (auto _ : state) {
    tracker.reset();
    benchmark::DoNotOptimize(tracker.update(top_camera().image));
  }
}
BENCHMARK(whole_image)->Name("vision/tracker_whole_image");

void empty_image(benchmark::State& state) {
  BlobTracker tracker(top_camera().background, {});
  tracker.update(top_camera().image);
  for (auto _ : state) benchmark::DoNotOptimize(tracker.update(top_camera().empty));
}
BENCHMARK(empty_image)->Name("vision/tracker_lost");

void overlay(benchmark::State& state) {
  Overlay what;
  what.tracked = top_camera().truth;
  for (auto _ : state) benchmark::DoNotOptimize(draw_overlay(top_camera().image, what));
}
BENCHMARK(overlay)->Name("vision/draw_overlay");

}  // namespace
