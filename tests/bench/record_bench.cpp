// Bench of recording: 8 currents and a pose (x, y, z, axis) at 1 kHz, 640x480 frames at 60 per
// second, for 60 s of real time; the goal is 15 % of one core with nothing dropped. The share is
// all the process used, the feeding included.
// SPDX-License-Identifier: Apache-2.0
#include "host/record/recorder.h"

#include <benchmark/benchmark.h>
#include <opencv2/core.hpp>

#include <array>
#include <chrono>
#include <filesystem>
#include <stdlib.h>
#include <thread>
#include <time.h>

namespace vitreo {
namespace {

double cpu_seconds() {
  timespec time{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

StreamInfo stream(const std::string& name, const std::vector<std::string>& channels) {
  StreamInfo info{name, "bench", {}};
  for (const std::string& channel : channels) info.channels.push_back({channel, ""});
  return info;
}

void record(Recorder& recorder, int seconds) {
  const int currents =
      recorder.add_stream(stream("currents", {"i1", "i2", "i3", "i4", "i5", "i6", "i7", "i8"}));
  const int pose =
      recorder.add_stream(stream("pose", {"x", "y", "z", "axis_x", "axis_y", "axis_z"}));
  const int camera = recorder.add_camera({"top_camera", "bench", 1, 1 / 60.0, 1e-6});
  std::array<cv::Mat, 8> images;
  for (cv::Mat& image : images) {
    image.create(480, 640, CV_8UC1);
    cv::RNG(7).fill(image, cv::RNG::UNIFORM, 0, 255);
  }
  const auto begin = std::chrono::steady_clock::now();
  std::int64_t frames = 0;
  for (std::int64_t tick = 0; tick < 1000LL * seconds; ++tick) {
    std::this_thread::sleep_until(begin + std::chrono::milliseconds(tick));
    const Time now = std::chrono::milliseconds(tick);
    const double value = static_cast<double>(tick) * 1e-3;
    recorder.sample(currents, now, std::array{value, 1.1, 2.2, 3.3, 4.4, 5.5, 6.6, 7.7});
    recorder.sample(pose, now, std::array{value, 1e-3, 2e-3, 1.0, 0.0, 0.0});
    if (tick * 60 / 1000 < frames) continue;
    recorder.frame(camera, {images[static_cast<std::size_t>(frames) % 8],
                            static_cast<std::uint64_t>(frames), now, now});
    ++frames;
  }
}

void recording(benchmark::State& state) {
  std::string parent = "vitreo_bench_XXXXXX";  // here: /tmp may be memory, not a disk
  if (!mkdtemp(parent.data())) return state.SkipWithError("no folder can be made here");
  const int seconds = static_cast<int>(state.range(0));
  for (auto _ : state) {
    RecordLimits limits;
    limits.drop_frames = true;
    Recorder recorder(parent, RunStart{}, limits);
    const double before = cpu_seconds();
    record(recorder, seconds);
    static_cast<void>(recorder.frames());  // until all is written
    state.counters["core_percent"] = 100 * (cpu_seconds() - before) / seconds;
    recorder.finish({Outcome::completed, "", 1.0 * seconds, 1.0 * seconds});
    state.counters["frames_dropped"] = static_cast<double>(recorder.data().dropped[0]);
    state.counters["frames"] = static_cast<double>(recorder.data().frames.size());
    state.counters["held_ms"] = 1e3 * recorder.data().held;
  }
  std::filesystem::remove_all(parent);
}
BENCHMARK(recording)->Arg(60)->Iterations(1)->Unit(benchmark::kSecond)->UseRealTime();

}  // namespace
}  // namespace vitreo
