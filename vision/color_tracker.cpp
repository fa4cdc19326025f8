// SPDX-License-Identifier: Apache-2.0
#include "vision/color_tracker.h"

#include "vision/object_search.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>
#include <utility>

namespace vitreo::vision {
namespace {

constexpr double kSlow = 0.03;      // of the axes' mean, a frame
constexpr double kSteady = 0.6;     // of a velocity, from the last step; the rest from before
constexpr double kMostSize = 0.35;  // of an axis against the masks' mean, relative
constexpr double kAxesSigma = 1.0;  // px, of semi-axes against their slow mean
// A first look from a rough place that lands this near and sees this much of the rim needs no
// second one.
constexpr double kMostlySeen = 0.45;
constexpr double kRough = 4.0, kSure = 0.8;
constexpr double kCenterSigma = 5.0;  // px, of the place expected

void require(bool good, const char* what) {
  if (!good) throw std::invalid_argument(what);
}

bool within(double value, double mean, double share) {
  return std::abs(value - mean) <= share * mean;
}

}  // namespace

std::string name_of(TrackState state) {
  switch (state) {
    case TrackState::searching:
      return "searching";
    case TrackState::tracking:
      return "tracking";
    case TrackState::coasting:
      return "coasting";
    case TrackState::lost:
      break;
  }
  return "lost";
}

void ColorTrackerSettings::check() const {
  view.check();
  require(min_inliers >= 0.35 && min_inliers <= 1, "min_inliers: must be 0.35 to 1");
  require(min_inliers_new >= 0.35 && min_inliers_new <= 1, "min_inliers_new: must be 0.35 to 1");
  require(min_support >= 0 && min_support <= 1, "min_support: must be 0 to 1");
  require(max_against >= 0 && max_against <= 1, "max_against: must be 0 to 1");
  require(axis_change > 0 && axis_change <= 1, "axis_change: must be above 0, at most 1");
  require(jump_px > 0 && jump_px <= 1000, "jump_px: must be above 0, at most 1000");
  require(coast_frames >= 0 && coast_frames <= 1000, "coast_frames: must be 0 to 1000");
  require(coast_px >= 0 && coast_px <= 20, "coast_px: must be 0 to 20");
  require(candidates >= 1 && candidates <= 8, "candidates: must be 1 to 8");
}

struct ColorTracker::State : TrackMemory {
  State(ObjectModel learnt, const ColorTrackerSettings& chosen)
      : model(std::move(learnt)),
        settings(chosen),
        view(model, settings.view),
        search({{0, 0}, model.semi_axes_px.x(), model.semi_axes_px.y(), 0}) {}

  Ellipse expected() const;
  bool near_expected(const cv::Mat& image, const Owned& owned, Track& track);
  bool anywhere(const cv::Mat& image, const Owned& owned, Track& track);
  bool good(const Look& look, const Ellipse& start, const Eigen::Vector2d& axes, double jump,
            double inliers) const;
  bool in_image(const Ellipse& e) const;
  void accept(const Look& look, Track& track, bool anew);
  EllipseMeasurement calibrated(const EllipseMeasurement& raw) const;

  ObjectModel model;
  ColorTrackerSettings settings;
  ObjectView view;
  ObjectSearch search;
  void not_seen();
};

bool ColorTracker::State::in_image(const Ellipse& e) const {
  return e.center_px.allFinite() && e.center_px.x() >= 0 && e.center_px.y() >= 0 &&
         e.center_px.x() <= model.image_size.width - 1 &&
         e.center_px.y() <= model.image_size.height - 1;
}

// Constant velocity, which fades while it is not seen.
Ellipse ColorTracker::State::expected() const {
  const double frames = std::min(unseen + 1, 3);
  Ellipse e{last.center_px + frames * velocity_px, axes_px.x(), axes_px.y(),
            last.angle + frames * turn};
  e.angle = std::remainder(e.angle, std::numbers::pi);
  return e;
}

bool ColorTracker::State::good(const Look& look, const Ellipse& start, const Eigen::Vector2d& axes,
                               double jump, double inliers) const {
  if (look.leaked || !look.measured || look.measured->inlier_fraction < inliers) return false;
  const Ellipse& e = look.measured->ellipse;
  if (!in_image(e) || (e.center_px - start.center_px).norm() > jump) return false;
  if (!within(e.semi_major_px, axes.x(), settings.axis_change)) return false;
  if (!within(e.semi_minor_px, axes.y(), settings.axis_change)) return false;
  const Eigen::Vector2d trained =
      model.semi_axes_px + (settings.view.refine ? model.rim : model.segment).semi_axes_px;
  if (!within(e.semi_major_px, trained.x(), kMostSize) ||
      !within(e.semi_minor_px, trained.y(), kMostSize))
    return false;
  // Where the rim is hidden the inside may be too; a whole rim around ground is a crossing of
  // vessels.
  if (look.measured->inlier_fraction > kMostlySeen && look.against > settings.max_against)
    return false;
  return look.support >= settings.min_support;
}

EllipseMeasurement ColorTracker::State::calibrated(const EllipseMeasurement& raw) const {
  const Calibration& calibration = settings.view.refine ? model.rim : model.segment;
  EllipseMeasurement result = raw;
  result.ellipse.semi_major_px -= calibration.semi_axes_px.x();
  result.ellipse.semi_minor_px = std::min(raw.ellipse.semi_minor_px - calibration.semi_axes_px.y(),
                                          result.ellipse.semi_major_px);
  result.covariance += calibration.covariance;
  return result;
}

void ColorTracker::State::accept(const Look& look, Track& track, bool anew) {
  const Ellipse& e = look.measured->ellipse;
  if (anew) {
    velocity_px.setZero();
    turn = 0;
    if (state == TrackState::searching) axes_px = {e.semi_major_px, e.semi_minor_px};
  } else {
    const double frames = unseen + 1;
    const Eigen::Vector2d step = (e.center_px - last.center_px) / frames;
    const double turned = std::remainder(e.angle - last.angle, std::numbers::pi) / frames;
    velocity_px = step + (1 - kSteady) * (velocity_px - step);
    turn = std::clamp(turned + (1 - kSteady) * (turn - turned), -0.15, 0.15);
    // A half hidden object's axes are those expected: nothing to learn from them.
    if (look.measured->inlier_fraction > 0.7)
      axes_px += kSlow * (Eigen::Vector2d(e.semi_major_px, e.semi_minor_px) - axes_px);
  }
  last = e;
  unseen = 0;
  state = TrackState::tracking;
  track.measured = calibrated(*look.measured);
  track.support = look.support;
  track.area_px = look.segment.area_px;
  track.iterations = look.iterations;
}

bool ColorTracker::State::near_expected(const cv::Mat& image, const Owned& owned, Track& track) {
  const Ellipse start = expected();
  track.expected = start;
  if (!in_image(start)) return false;
  const double more = settings.coast_px * std::min(unseen, settings.coast_frames);
  const EllipsePrior prior{start, kCenterSigma + more, kAxesSigma,
                           settings.view.angle_sigma + 0.03 * unseen};
  // A front that a vessel has led astray gets a second chance, without it.
  for (const bool from_front : {true, false}) {
    const Look look =
        view.look(image, start, settings.view.gate_px + more, prior, owned, from_front);
    if (!good(look, start, axes_px, settings.jump_px + more, settings.min_inliers)) continue;
    accept(look, track, false);
    return true;
  }
  return false;
}

bool ColorTracker::State::anywhere(const cv::Mat& image, const Owned& owned, Track& track) {
  const Eigen::Vector2d middle(image.cols / 2.0, image.rows / 2.0);
  const bool known = state != TrackState::searching;
  const Eigen::Vector2d axes =
      known ? axes_px
            : Eigen::Vector2d(model.semi_axes_px +
                              (settings.view.refine ? model.rim : model.segment).semi_axes_px);
  const auto& places = search.find(image, model.color, known ? last.center_px : middle,
                                   settings.candidates, owned.map, owned.self);
  for (Ellipse start : places) {
    start.semi_major_px = axes.x();
    start.semi_minor_px = axes.y();
    Look look;
    // Twice at most: from the rough place, then from what that gave.
    for (int round = 0; round < 2; ++round) {
      if (!in_image(start)) break;
      const EllipsePrior prior{start, 8, 2.5, 0.4};
      look = view.look(image, start, settings.view.gate_px, prior, owned);
      if (!look.measured) break;
      const bool near = (look.measured->ellipse.center_px - start.center_px).norm() < kRough;
      start = look.measured->ellipse;
      if (near && look.measured->inlier_fraction > kSure) break;
    }
    if (!good(look, start, axes, settings.jump_px, settings.min_inliers_new)) continue;
    accept(look, track, true);
    return true;
  }
  return false;
}

ColorTracker::ColorTracker(ObjectModel model, const ColorTrackerSettings& settings) {
  settings.check();
  if (model.color.table().empty() || model.shape.samples().empty())
    throw std::invalid_argument("model: is not trained");
  state_ = std::make_unique<State>(std::move(model), settings);
}

ColorTracker::~ColorTracker() = default;

void ColorTracker::reset() { state_->state = TrackState::searching; }

void ColorTracker::place(const Ellipse& at) {
  State& s = *state_;
  require(s.in_image(at), "at: its center is not in the image");
  require(at.semi_minor_px > 1 && at.semi_major_px >= at.semi_minor_px &&
              std::isfinite(at.semi_major_px + at.angle),
          "at: its axes are not those of an ellipse");
  s.last = at;
  s.axes_px = s.model.semi_axes_px;
  s.velocity_px.setZero();
  s.turn = 0;
  s.unseen = 0;
  s.state = TrackState::tracking;
}

TrackState ColorTracker::state() const { return state_->state; }
const ObjectModel& ColorTracker::model() const { return state_->model; }
const TrackMemory& ColorTracker::memory() const { return *state_; }
void ColorTracker::restore(const TrackMemory& memory) {
  static_cast<TrackMemory&>(*state_) = memory;
}

std::optional<Ellipse> ColorTracker::expected() const {
  if (state_->state == TrackState::searching) return std::nullopt;
  return state_->expected();
}

void ColorTracker::State::not_seen() {
  if (state == TrackState::searching) return;
  ++unseen;
  state = unseen > settings.coast_frames ? TrackState::lost : TrackState::coasting;
}

Track ColorTracker::miss() {
  Track track;
  track.expected = expected();
  state_->not_seen();
  track.state = state_->state;
  return track;
}

Track ColorTracker::update(const cv::Mat& image, const Owned& owned) {
  State& s = *state_;
  require(image.type() == CV_8UC3, "image: must be 8-bit color (BGR)");
  require(image.size() == s.model.image_size, "image: its size differs from the training images'");
  require(owned.map.empty() || (owned.map.type() == CV_8UC1 && owned.map.size() == image.size()),
          "owned: must be 8-bit gray of the image's size");
  Track track;
  const bool followed = s.state == TrackState::tracking || s.state == TrackState::coasting;
  bool found = followed && s.near_expected(image, owned, track);
  if (!found && followed) s.not_seen();
  if (!found && (s.state == TrackState::searching || s.state == TrackState::lost))
    found = s.anywhere(image, owned, track);
  track.state = s.state;
  return track;
}

}  // namespace vitreo::vision
