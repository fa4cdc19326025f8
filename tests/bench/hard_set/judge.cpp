// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/hard_set/judge.h"

#include "vision/multi_tracker.h"

#include <Eigen/LU>

#include <algorithm>
#include <cstdio>
#include <ctime>
#include <limits>
#include <optional>

namespace vitreo::hard_set {
namespace {

constexpr double kSeen = 0.3;        // share of the robot from which it is to be tracked
constexpr double kInside95 = 5.991;  // chi^2 of two
constexpr double kFarPx = 5;
constexpr double kFarSigma = 5;
constexpr int kFindingFrames = 2;  // that may pass before a robot in view is called lost

// CPU time of this thread: other programs on the machine do not count.
double cpu_seconds() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + static_cast<double>(t.tv_nsec) * 1e-9;
}

// One robot's verdict, frame by frame.
class Account {
 public:
  // A robot that just came into view is not lost yet: a find has to be believed first.
  void frame(const vision::Track& track, const vision::Ellipse& truth, double visible) {
    const bool shown = visible >= kSeen;
    in_view_ = visible > 0 ? in_view_ + 1 : 0;
    if (in_view_ == 0) found_ = false;
    verdict.shown += shown;
    if (track.state != vision::TrackState::tracking) {
      verdict.lost += shown && in_view_ > kFindingFrames;
      if (!found_ && in_view_ > 0)
        verdict.found_after = std::max(verdict.found_after, in_view_ + 1);
      return;
    }
    ++verdict.tracked;
    if (visible <= 0) {
      ++verdict.wrong;
      return;
    }
    measured(*track.measured, truth);
    found_ = true;
  }
  Verdict verdict;

 private:
  // The rule: wrong is beyond 5 px or beyond 5 sigma, whichever comes first.
  void measured(const vision::EllipseMeasurement& seen, const vision::Ellipse& truth) {
    const Eigen::Vector2d off = seen.ellipse.center_px - truth.center_px;
    const Eigen::Matrix2d covariance = seen.covariance.topLeftCorner<2, 2>();
    const double squared = off.dot(covariance.inverse() * off);
    ++verdict.there;
    verdict.off_px += off.norm();
    verdict.du += off.x(), verdict.dv += off.y();
    verdict.inside += squared < kInside95;
    verdict.beyond_sigma += squared > kFarSigma * kFarSigma;
    verdict.wrong += off.norm() > kFarPx || squared > kFarSigma * kFarSigma;
  }
  int in_view_ = 0;
  bool found_ = false;
};

// For a look at one sequence: what was believed, how surely, and what it was.
void print_frame(int k, const vision::Track& track, const Shot& shot, double seconds) {
  std::printf("%3d %-9s %5.0f us truth %6.1f %6.1f visible %.2f", k, name_of(track.state).c_str(),
              1e6 * seconds, shot.truth.center_px.x(), shot.truth.center_px.y(), shot.visible);
  if (track.measured) {
    const vision::EllipseMeasurement& m = *track.measured;
    std::printf(
        "  seen %6.1f %6.1f (%5.1f %5.1f) sigma %.2f inliers %.2f contrast %.2f support %.2f",
        m.ellipse.center_px.x(), m.ellipse.center_px.y(), m.ellipse.semi_major_px,
        m.ellipse.semi_minor_px, std::sqrt(m.covariance.topLeftCorner<2, 2>().trace() / 2),
        m.inlier_fraction, m.contrast, track.support);
  }
  std::printf("  likeness %.1f", track.likeness);
  if (track.margin) std::printf(" margin %.1f", *track.margin);
  std::printf("\n");
}

// Both robots are pointed at in the first frame, as an operator would.
Verdict judge_twins(const Scene& scene, const vision::ObjectModel& model,
                    const JudgeSettings& settings) {
  vision::MultiTracker tracker({{model, settings.tracker}, {model, settings.tracker}});
  Account one;
  Account other;
  for (int k = 0; k < Scene::kFrames; ++k) {
    const Shot shot = scene.shot(k);
    if (k == 0) {
      tracker.place(0, shot.truth);
      tracker.place(1, shot.twin);
    }
    const double start = cpu_seconds();
    const std::vector<vision::Track>& tracks = tracker.update(shot.image);
    const double took = cpu_seconds() - start;
    one.verdict.seconds += took;
    one.verdict.worst_seconds = std::max(one.verdict.worst_seconds, took);
    ++one.verdict.frames;
    // One robot lies over the other while they cross.
    const double apart = (shot.truth.center_px - shot.twin.center_px).norm();
    const double twin_shows = std::clamp(apart / (2 * shot.truth.semi_minor_px), 0.01, 1.0);
    one.frame(tracks[0], shot.truth, shot.visible);
    const cv::Rect2d view({0, 0}, cv::Size2d(shot.image.size()));
    const bool in_view = view.contains({shot.twin.center_px.x(), shot.twin.center_px.y()});
    other.frame(tracks[1], shot.twin, in_view && twin_shows > 0.6 ? 1 : 0.1);
    if (settings.each_frame) print_frame(k, tracks[0], shot, took);
  }
  one.verdict.add(other.verdict);
  return one.verdict;
}

// What each frame costs in `repeats` further runs by trackers of their own, the least: the same
// work is done in all, and what other programs take from caches and cores is in the rest.
std::vector<double> least_seconds(const std::vector<Shot>& shots, const vision::ObjectModel& model,
                                  const JudgeSettings& settings) {
  std::vector<double> least(shots.size(), std::numeric_limits<double>::infinity());
  for (int r = 0; r < settings.repeats; ++r) {
    vision::ColorTracker tracker(model, settings.tracker);
    for (std::size_t k = 0; k < shots.size(); ++k) {
      const double start = cpu_seconds();
      tracker.update(shots[k].image);
      least[k] = std::min(least[k], cpu_seconds() - start);
    }
  }
  return least;
}

}  // namespace

void Verdict::add(const Verdict& o) {
  shown += o.shown, lost += o.lost, tracked += o.tracked, wrong += o.wrong;
  beyond_sigma += o.beyond_sigma, inside += o.inside, there += o.there;
  found_after = std::max(found_after, o.found_after);
  du += o.du, dv += o.dv, off_px += o.off_px, seconds += o.seconds, frames += o.frames;
  worst_seconds = std::max(worst_seconds, o.worst_seconds);
}

// One tracker from the first frame to the last, nothing pointed at: it finds the robot by itself.
Verdict judge(const Scene& scene, const vision::ObjectModel& model, const JudgeSettings& settings) {
  if (scene.variant().twin) return judge_twins(scene, model, settings);
  vision::ColorTracker tracker(model, settings.tracker);
  if (settings.each_frame) {
    std::printf("audit: %d of %d, most likeness %.1f; %zu looks, %zu others\n",
                model.audit.as_trained.answered, model.audit.asked,
                model.audit.as_trained.most_likeness, model.looks.objects(), model.looks.others());
    for (const std::string& warning : model.warnings()) std::printf("%s\n", warning.c_str());
  }
  Account account;
  std::vector<Shot> shots;
  for (int k = 0; k < Scene::kFrames; ++k) shots.push_back(scene.shot(k));
  const std::vector<double> took = least_seconds(shots, model, settings);
  for (int k = 0; k < Scene::kFrames; ++k) {
    const Shot& shot = shots[static_cast<std::size_t>(k)];
    const double start = cpu_seconds();
    const vision::Track track = tracker.update(shot.image);
    const double now = cpu_seconds() - start;
    const double least = std::min(now, took[static_cast<std::size_t>(k)]);
    account.verdict.seconds += least;
    account.verdict.worst_seconds = std::max(account.verdict.worst_seconds, least);
    ++account.verdict.frames;
    account.frame(track, shot.truth, shot.visible);
    if (settings.each_frame) print_frame(k, track, shot, least);
  }
  return account.verdict;
}

}  // namespace vitreo::hard_set
