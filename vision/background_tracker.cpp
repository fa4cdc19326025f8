// SPDX-License-Identifier: Apache-2.0
#include "vision/background_tracker.h"

#include "vision/moments.h"
#include "vision/preconditions.h"

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/video/background_segm.hpp>

#include <algorithm>
#include <array>
#include <stdexcept>

namespace vitreo::vision {
namespace {

struct NamedKind {
  BackgroundKind kind;
  const char* name;
};
constexpr std::array<NamedKind, 4> kKinds{{{BackgroundKind::fixed, "fixed"},
                                           {BackgroundKind::running, "running"},
                                           {BackgroundKind::mog2, "mog2"},
                                           {BackgroundKind::knn, "knn"}}};

}  // namespace

// By position: kKinds has the order of the enum.
std::string name_of(BackgroundKind kind) { return kKinds[static_cast<std::size_t>(kind)].name; }

BackgroundKind background_kind(const std::string& name) {
  for (const NamedKind& one : kKinds)
    if (name == one.name) return one.kind;
  throw std::invalid_argument("kind: there is fixed, running, mog2, knn; got " + name);
}

void BackgroundTrackerSettings::check() const {
  require(threshold > 0 && threshold <= 255, "threshold: must be above 0, at most 255");
  require(rate >= 0 && rate <= 1, "rate: must be 0 to 1");
  require(min_area_px >= 1, "min_area_px: must be at least 1");
  require(max_area_px == 0 || max_area_px >= min_area_px, "max_area_px: is below min_area_px");
}

struct BackgroundTracker::State {
  void check_image(const cv::Mat& image) const;
  void learn_plain(const cv::Mat& image, double rate, const cv::Mat& where);
  void find_foreground(const cv::Mat& image);
  std::optional<Ellipse> largest();

  BackgroundTrackerSettings settings;
  cv::Ptr<cv::BackgroundSubtractor> subtractor;
  int learnt = 0;
  cv::Size size;
  int type = 0;
  cv::Mat mean;   // CV_32F
  cv::Mat level;  // the mean, rounded
  cv::Mat difference;
  cv::Mat foreground;
  cv::Mat labels;
  cv::Mat statistics;
  cv::Mat centroids;
};

// Every image must be as the first: the mean and OpenCV's models have one state per pixel and
// channel.
// Throws std::invalid_argument: OpenCV would end the call with an error of its own that names no
// argument.
void BackgroundTracker::State::check_image(const cv::Mat& image) const {
  require(image.type() == CV_8UC1 || image.type() == CV_8UC3,
          "image: must be 8-bit, gray or color");
  require(!image.empty(), "image: is empty");
  require(learnt == 0 || (image.size() == size && image.type() == type),
          "image: is not of the size and kind learnt");
}

// Exponential mean m <- (1 - rate) m + rate I where `where` is not 0 (everywhere, if empty); with
// the rate 1 / n of learn() the plain mean of n images.
// A float mean, as a rate of 0.02 would never move an 8-bit one by a level.
void BackgroundTracker::State::learn_plain(const cv::Mat& image, double rate,
                                           const cv::Mat& where) {
  if (mean.empty()) image.convertTo(mean, CV_32F);
  cv::accumulateWeighted(image, mean, rate, where);
}

// Foreground: the subtractor's own decision, or |I - mean| above the threshold in the channel that
// differs most. The running mean is updated only where there is no foreground, so that a robot that
// holds still is not absorbed.
// OpenCV's models learn the robot too when it holds still, which is what the fixed background is
// for.
void BackgroundTracker::State::find_foreground(const cv::Mat& image) {
  if (subtractor) {
    subtractor->apply(image, foreground, settings.rate);
    // 255 is foreground, 127 a shadow.
    cv::threshold(foreground, foreground, 200, 255, cv::THRESH_BINARY);
    return;
  }
  mean.convertTo(level, CV_8U);
  cv::absdiff(image, level, difference);
  if (difference.channels() == 3) {
    std::array<cv::Mat, 3> of;
    cv::split(difference, of.data());
    cv::max(of[0], of[1], difference);
    cv::max(difference, of[2], difference);
  }
  cv::compare(difference, settings.threshold, foreground, cv::CMP_GT);
  if (settings.kind == BackgroundKind::running) {
    cv::Mat still;
    cv::bitwise_not(foreground, still);
    learn_plain(image, settings.rate, still);
  }
}

// The moment ellipse of the largest connected component of admissible area. Opening and closing by
// 5 px is the "morphological filtering" of thesis 5.5.
// Nothing when the largest admissible component is thinner than a pixel. No covariance: moments of
// a thresholded mask have no error model.
std::optional<Ellipse> BackgroundTracker::State::largest() {
  const cv::Mat element = cv::getStructuringElement(cv::MORPH_ELLIPSE, {5, 5});
  cv::morphologyEx(foreground, foreground, cv::MORPH_OPEN, element);
  cv::morphologyEx(foreground, foreground, cv::MORPH_CLOSE, element);
  const int count = cv::connectedComponentsWithStats(foreground, labels, statistics, centroids);
  // Label 0 is the background. More than a tenth of the image is a change of the light, not a
  // robot.
  const double most =
      settings.max_area_px > 0 ? settings.max_area_px : 0.1 * static_cast<double>(size.area());
  int best = 0;
  int best_area = 0;
  for (int k = 1; k < count; ++k) {
    const int area = statistics.at<int>(k, cv::CC_STAT_AREA);
    if (area >= settings.min_area_px && area <= most && area > best_area)
      best = k, best_area = area;
  }
  if (best == 0) return std::nullopt;
  cv::Mat part;
  cv::compare(labels, best, part, cv::CMP_EQ);
  const Ellipse found = moments_of(part).ellipse({0, 0});
  if (!(found.semi_minor_px > 0.5)) return std::nullopt;
  return found;
}

BackgroundTracker::BackgroundTracker(const BackgroundTrackerSettings& settings)
    : state_(std::make_unique<State>()) {
  settings.check();
  state_->settings = settings;
  if (settings.kind == BackgroundKind::mog2)
    state_->subtractor = cv::createBackgroundSubtractorMOG2();
  if (settings.kind == BackgroundKind::knn)
    state_->subtractor = cv::createBackgroundSubtractorKNN();
}

BackgroundTracker::~BackgroundTracker() = default;

// OpenCV's subtractors learn at the same rate, 1 / n for the n-th image.
// The first image makes the mean; before it update() has nothing to compare with.
void BackgroundTracker::learn(const cv::Mat& image) {
  State& s = *state_;
  s.check_image(image);
  s.size = image.size();
  s.type = image.type();
  ++s.learnt;
  if (s.subtractor)
    s.subtractor->apply(image, s.foreground, 1.0 / s.learnt);
  else
    s.learn_plain(image, 1.0 / s.learnt, {});
}

// Not const: all kinds but `fixed` learn from each image.
std::optional<Ellipse> BackgroundTracker::update(const cv::Mat& image) {
  State& s = *state_;
  if (s.learnt == 0) throw std::logic_error("nothing was learnt: show it the empty scene first");
  s.check_image(image);
  s.find_foreground(image);
  return s.largest();
}

}  // namespace vitreo::vision
