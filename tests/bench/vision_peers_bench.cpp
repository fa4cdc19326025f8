// Bench of common trackers on the frames of the color tracker's bench: OpenCV's background models,
// and CamShift on our own evidence. `slower`: their time over ours; `lost` of 100 frames: no
// answer, or more than 10 px off.
// SPDX-License-Identifier: Apache-2.0
#include "tests/vision/sequence_generator.h"
#include "vision/background_tracker.h"
#include "vision/color_tracker.h"

#include <benchmark/benchmark.h>
#include <opencv2/video/tracking.hpp>

#include <algorithm>
#include <ctime>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

namespace {

using namespace vitreo::vision;

constexpr int kFrames = 100;

struct Recording {
  generated::Sequence sequence{{.seed = 72, .fundus = true}};
  ObjectModel model = ObjectModel::train(sequence.training(24), {}, {});
  std::vector<generated::Frame> frames;
  std::vector<cv::Mat> empty;  // the scene without the robot, for those that must learn it
  Recording() {
    cv::setNumThreads(1);
    for (int k = 0; k < kFrames; ++k) frames.push_back(sequence.frame(k));
    generated::Sequence away({.seed = 72, .fundus = true, .path = [](int) {
                                return Ellipse{{-200, -200}, 30, 15, 0};
                              }});
    for (int k = 0; k < 40; ++k) empty.push_back(away.frame(k).image);
  }
};

const Recording& recording() {
  static const Recording instance;
  return instance;
}

double thread_microseconds() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) * 1e6 + static_cast<double>(t.tv_nsec) * 1e-3;
}

using Find = std::function<std::optional<Ellipse>(const cv::Mat&)>;

struct Score {
  double microseconds = 0, center_px = 0;
  int lost = 0;
};

/// Over all frames in their order, once.
Score score(const Find& find) {
  Score score;
  int seen = 0;
  for (const generated::Frame& frame : recording().frames) {
    const double start = thread_microseconds();
    const auto found = find(frame.image);
    score.microseconds += (thread_microseconds() - start) / kFrames;
    const double off = found ? (found->center_px - frame.truth.center_px).norm() : 1e9;
    if (off > 10) {
      ++score.lost;
      continue;
    }
    score.center_px += off;
    ++seen;
  }
  score.center_px /= std::max(seen, 1);
  return score;
}

Find ours() {
  auto tracker = std::make_shared<ColorTracker>(recording().model, ColorTrackerSettings{});
  return [tracker](const cv::Mat& image) -> std::optional<Ellipse> {
    const Track track = tracker->update(image);
    if (!track.measured) return std::nullopt;
    return track.measured->ellipse;
  };
}

Find background(BackgroundKind kind) {
  BackgroundTrackerSettings settings;
  settings.kind = kind;
  auto tracker = std::make_shared<BackgroundTracker>(settings);
  for (const cv::Mat& image : recording().empty) tracker->learn(image);
  return [tracker](const cv::Mat& image) { return tracker->update(image); };
}

// F of the whole image, as bytes, then CamShift from where the robot is at first.
Find cam_shift() {
  const Ellipse first = recording().frames[0].truth;
  auto window = std::make_shared<cv::Rect>(static_cast<int>(first.center_px.x()) - 33,
                                           static_cast<int>(first.center_px.y()) - 33, 66, 66);
  return [window](const cv::Mat& image) -> std::optional<Ellipse> {
    cv::Mat likely(image.size(), CV_8UC1);
    const std::int8_t* table = recording().model.color.table().data();
    for (int v = 0; v < image.rows; ++v) {
      const auto* from = image.ptr<cv::Vec3b>(v);
      auto* to = likely.ptr<unsigned char>(v);
      for (int u = 0; u < image.cols; ++u)
        to[u] = static_cast<unsigned char>(
            2 * std::max<int>(table[ColorModel::cell_of(from[u][0], from[u][1], from[u][2])], 0));
    }
    if (window->area() < 1) return std::nullopt;
    const cv::RotatedRect box =
        cv::CamShift(likely, *window, {cv::TermCriteria::EPS | cv::TermCriteria::COUNT, 10, 1});
    if (!(box.size.width > 1 && box.size.height > 1)) return std::nullopt;
    return Ellipse{{box.center.x, box.center.y}, box.size.height / 2.0, box.size.width / 2.0, 0};
  };
}

void peer(benchmark::State& state, Find (*make)()) {
  const double own = score(ours()).microseconds;
  Score last;
  for (auto _ : state) last = score(make());
  state.counters["frame_us"] = last.microseconds;
  state.counters["slower"] = last.microseconds / own;
  state.counters["lost"] = last.lost;
  state.counters["center_px"] = last.center_px;
}

template <BackgroundKind kKind>
Find background_of() {
  return background(kKind);
}

BENCHMARK_CAPTURE(peer, ours, ours)->Name("vision/peers_ours")->Iterations(1);
BENCHMARK_CAPTURE(peer, fixed, background_of<BackgroundKind::fixed>)
    ->Name("vision/peers_fixed_background")
    ->Iterations(1);
BENCHMARK_CAPTURE(peer, running, background_of<BackgroundKind::running>)
    ->Name("vision/peers_running_mean")
    ->Iterations(1);
BENCHMARK_CAPTURE(peer, mog2, background_of<BackgroundKind::mog2>)
    ->Name("vision/peers_opencv_mog2")
    ->Iterations(1);
BENCHMARK_CAPTURE(peer, knn, background_of<BackgroundKind::knn>)
    ->Name("vision/peers_opencv_knn")
    ->Iterations(1);
BENCHMARK_CAPTURE(peer, cam_shift, cam_shift)->Name("vision/peers_opencv_camshift")->Iterations(1);

}  // namespace
