// Bench of exports: 337 frames of 1384x1036 with a camera's noise, at 15 Hz, and a stream; the goal
// is 5 s for MCAP. Wall time, and the time of all threads and of ffmpeg beside it.
// SPDX-License-Identifier: Apache-2.0
#include "host/record/recorder.h"
#include "host/runs/export.h"
#include "host/runs/run_reader.h"

#include <benchmark/benchmark.h>
#include <opencv2/core.hpp>

#include <array>
#include <cmath>
#include <filesystem>
#include <stdlib.h>
#include <string>
#include <sys/resource.h>
#include <vector>

namespace vitreo {
namespace {

constexpr int kFrames = 337;

double cpu_seconds() {
  double sum = 0;
  for (const int whose : {RUSAGE_SELF, RUSAGE_CHILDREN}) {
    rusage used{};
    getrusage(whose, &used);
    for (const timeval& part : {used.ru_utime, used.ru_stime})
      sum += static_cast<double>(part.tv_sec) + 1e-6 * static_cast<double>(part.tv_usec);
  }
  return sum;
}

/// A smooth ground with two gray levels of noise: of the simulated eye's kind.
std::vector<cv::Mat> images() {
  cv::Mat ground(1036, 1384, CV_8UC1);
  for (int v = 0; v < ground.rows; ++v)
    for (int u = 0; u < ground.cols; ++u)
      ground.at<unsigned char>(v, u) =
          static_cast<unsigned char>(100 + 60 * std::sin(u * 0.01) * std::cos(v * 0.013));
  std::vector<cv::Mat> all;
  for (int i = 0; i < 8; ++i) {
    cv::Mat noise(ground.size(), CV_8SC1);
    cv::RNG(static_cast<std::uint64_t>(i)).fill(noise, cv::RNG::NORMAL, 0, 2);
    cv::Mat image;
    cv::add(ground, noise, image, cv::noArray(), CV_8UC1);
    all.push_back(image);
  }
  return all;
}

std::filesystem::path recorded(const std::filesystem::path& parent) {
  Recorder recorder(parent, RunStart{});
  const int stream = recorder.add_stream({"pose", "bench", {{"x", "m"}, {"y", "m"}, {"z", "m"}}});
  const int camera = recorder.add_camera({"top_camera", "bench", 1, 1 / 15.0, 14.3e-6});
  const std::vector<cv::Mat> frames = images();
  for (int i = 0; i < kFrames; ++i) {
    const Time time = from_seconds(i / 15.0);
    recorder.frame(camera, {frames[static_cast<std::size_t>(i) % frames.size()],
                            static_cast<std::uint64_t>(i), time, time});
    recorder.sample(stream, time, std::array{1e-3, 2e-3, 3e-3});
  }
  recorder.finish({Outcome::completed, "", kFrames / 15.0, 1});
  return recorder.folder();
}

void exporting(benchmark::State& state) {
  const ExportFormat& format = export_formats().at(static_cast<std::size_t>(state.range(0)));
  state.SetLabel(format.name);
  std::string parent = "vitreo_bench_XXXXXX";  // here: /tmp may be memory, not a disk
  if (!mkdtemp(parent.data())) return state.SkipWithError("no folder can be made here");
  const RunData data = read_run(recorded(parent));
  std::uintmax_t bytes = 0;
  for (auto _ : state) {
    const double before = cpu_seconds();
    ExportFolder folder(std::filesystem::path(parent) / "export", true);
    format.write(data, folder);
    bytes = 0;
    for (const auto& file : folder.publish()) bytes += std::filesystem::file_size(file);
    state.counters["cpu_s"] = cpu_seconds() - before;
  }
  state.counters["MB"] = static_cast<double>(bytes) / 1e6;
  std::filesystem::remove_all(parent);
}
BENCHMARK(exporting)
    ->DenseRange(0, 5)
    ->Iterations(1)
    ->Unit(benchmark::kSecond)
    ->UseRealTime()
    ->MeasureProcessCPUTime();

}  // namespace
}  // namespace vitreo
