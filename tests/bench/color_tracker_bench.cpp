// The color tracker's speed at 640x480 with a robot of 60x30 px, frames in memory, one thread;
// OpenCV's own beside it.
// SPDX-License-Identifier: Apache-2.0
#include "tests/vision/sequence_generator.h"
#include "vision/color_tracker.h"
#include "vision/object_search.h"

#include <benchmark/benchmark.h>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <ctime>
#include <vector>

namespace {

using namespace vitreo::vision;

constexpr int kFrames = 100;

struct Recording {
  generated::Sequence sequence{{.seed = 71}};
  std::vector<LabeledImage> training = sequence.training(24);
  std::vector<cv::Mat> images;
  Recording() {
    cv::setNumThreads(1);
    for (int k = 0; k < kFrames; ++k) images.push_back(sequence.frame(k).image);
  }
};

const Recording& recording() {
  static const Recording instance;
  return instance;
}

// There and back, so that the robot never jumps.
const cv::Mat& frame(int k) {
  const int at = k % (2 * kFrames - 2);
  return recording().images[static_cast<std::size_t>(at < kFrames ? at : 2 * kFrames - 2 - at)];
}

double thread_microseconds() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) * 1e6 + static_cast<double>(t.tv_nsec) * 1e-3;
}

ColorTrackerSettings settings_of(bool shape_prior, bool refine) {
  ColorTrackerSettings settings;
  settings.view.shape_prior = shape_prior;
  settings.view.refine = refine;
  return settings;
}

void track(benchmark::State& state, bool shape_prior, bool refine) {
  const ColorTrackerSettings settings = settings_of(shape_prior, refine);
  ColorTracker tracker(ObjectModel::train(recording().training, {}, settings.view), settings);
  int k = 0, tracked = 0;
  double worst = 0;
  for (auto _ : state) {
    const double start = thread_microseconds();
    const Track found = tracker.update(frame(k++));
    worst = std::max(worst, thread_microseconds() - start);
    tracked += found.state == TrackState::tracking;
  }
  state.counters["frames_per_second"] = benchmark::Counter(k, benchmark::Counter::kIsRate);
  state.counters["worst_us"] = worst;
  state.counters["tracked"] = static_cast<double>(tracked) / k;
}
BENCHMARK_CAPTURE(track, shi_karl, false, false)
    ->Name("vision/color_tracker_shi_karl")
    ->Iterations(10000);
BENCHMARK_CAPTURE(track, prior, true, false)
    ->Name("vision/color_tracker_shape_prior")
    ->Iterations(10000);
BENCHMARK_CAPTURE(track, refined, true, true)
    ->Name("vision/color_tracker_prior_refined")
    ->Iterations(10000);
BENCHMARK_CAPTURE(track, rim, false, true)->Name("vision/color_tracker_refined")->Iterations(10000);

// From nothing known to a measured robot, which one image alone does not make a believed one.
void detect(benchmark::State& state) {
  const ColorTrackerSettings settings = settings_of(true, true);
  ColorTracker tracker(ObjectModel::train(recording().training, {}, settings.view), settings);
  int k = 0, found = 0;
  for (auto _ : state) {
    tracker.reset();
    found += tracker.update(frame(k++)).candidate.has_value();
  }
  state.counters["found"] = static_cast<double>(found) / k;
}
BENCHMARK(detect)->Name("vision/color_tracker_detect_and_measure");

void search(benchmark::State& state) {
  const ObjectModel model = ObjectModel::train(recording().training, {}, {});
  ColorEvidence colors(model.color);
  ObjectSearch searcher({{0, 0}, model.semi_axes_px.x(), model.semi_axes_px.y(), 0});
  int k = 0;
  for (auto _ : state) benchmark::DoNotOptimize(searcher.find(frame(k++), colors, {320, 240}, 3));
}
BENCHMARK(search)->Name("vision/color_tracker_search_whole_image");

// Images of nothing but noise: the worst that can be asked of the search, the gate and the caps.
void noise(benchmark::State& state) {
  const ColorTrackerSettings settings = settings_of(true, true);
  ColorTracker tracker(ObjectModel::train(recording().training, {}, settings.view), settings);
  cv::Mat image(480, 640, CV_8UC3);
  cv::RNG random(5);
  random.fill(image, cv::RNG::UNIFORM, 0, 256);
  double worst = 0;
  for (auto _ : state) {
    tracker.place({{320, 240}, 30, 15, 0.3});
    const double start = thread_microseconds();
    benchmark::DoNotOptimize(tracker.update(image));
    worst = std::max(worst, thread_microseconds() - start);
  }
  state.counters["worst_us"] = worst;
}
BENCHMARK(noise)->Name("vision/color_tracker_noise");

// What a region of the thesis' own kind costs without a table: conversion and histogram look-up of
// the whole image.
void back_projection(benchmark::State& state) {
  cv::Mat hsv, likely;
  cv::Mat histogram = cv::Mat::ones(32, 32, CV_32F);
  const int channels[] = {0, 1};
  const float hue[] = {0, 180}, saturation[] = {0, 256};
  const float* ranges[] = {hue, saturation};
  int k = 0;
  for (auto _ : state) {
    cv::cvtColor(frame(k++), hsv, cv::COLOR_BGR2HSV);
    cv::calcBackProject(&hsv, 1, channels, histogram, likely, ranges);
    benchmark::DoNotOptimize(likely.data);
  }
}
BENCHMARK(back_projection)->Name("vision/peer_opencv_back_projection");

}  // namespace
