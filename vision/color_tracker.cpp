// SPDX-License-Identifier: Apache-2.0
#include "vision/color_tracker.h"

#include "vision/color_tracker_state.h"
#include "vision/preconditions.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

namespace vitreo::vision {
namespace {

constexpr double kMostAspect = 0.35;  // of an axis against the masks' at the same size, relative
// Of an axis' excess over its slow mean, the standard deviation that it stands for in the center:
// what lengthens an axis moves one end of it.
constexpr double kOneEnd = 0.4;
// Inlier fraction above which the rim is visible enough for its inside to be judged.
constexpr double kJudgedRim = 0.45;
// A look by which the light may be learnt: least shares of the rim and of colors for it, and the
// largest of colors against it.
constexpr double kSureRim = 0.75;
constexpr double kSureSupport = 0.6;
constexpr double kSureAgainst = 0.1;
// Of a heading: chance that it is another one in the next image, share of an image's log odds that
// counts, what is reported, and the share of the rim from which both ends are seen.
constexpr double kFlipped = 1e-4;
constexpr double kHeadShare = 0.4;
constexpr double kSureHead = 0.99;
constexpr double kWholeRim = 0.6;
// Of the work of a look at the trained size: what does not grow with the size, and what reading the
// colors in the gate is.
constexpr double kAnyLook = 0.5;
constexpr double kColorsAlone = 0.25;

bool within_share(double value, double mean, double share) {
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
  require(least_size > 0.1 && least_size <= 1 && most_size >= 1 && most_size <= 4,
          "least_size, most_size: must be 0.1 to 1 and 1 to 4");
  require(jump_px > 0 && jump_px <= 1000, "jump_px: must be above 0, at most 1000");
  require(coast_frames >= 0 && coast_frames <= 1000, "coast_frames: must be 0 to 1000");
  require(coast_px >= 0 && coast_px <= 20, "coast_px: must be 0 to 20");
  require(candidates >= 1 && candidates <= 8, "candidates: must be 1 to 8");
  require(confirm_frames >= 1 && confirm_frames <= 100, "confirm_frames: must be 1 to 100");
  require(std::isfinite(min_likeness) && std::isfinite(min_likeness_new) &&
              min_likeness <= min_likeness_new,
          "min_likeness: must be finite, and not above min_likeness_new");
  require(sure_margin >= 0 && moved_px >= 0, "sure_margin, moved_px: must be at least 0");
}

// The center decides: an object half out of the image is still tracked by the rim that is left.
bool ColorTracker::State::in_image(const Ellipse& e) const {
  return e.center_px.allFinite() && e.center_px.x() >= 0 && e.center_px.y() >= 0 &&
         e.center_px.x() <= model.image_size.width - 1 &&
         e.center_px.y() <= model.image_size.height - 1;
}

// A look at the object by its size: gate and front grow with it.
double ColorTracker::State::look_work(const Eigen::Vector2d& axes) const {
  return kAnyLook + (1 - kAnyLook) * std::sqrt(axes.prod() / trained_axes().prod());
}

// Of a gate in which nothing is the object's, or all of it, only the colors are read.
Observation ColorTracker::State::observe(const cv::Mat& image, const Ellipse& start, double gate_px,
                                         const EllipsePrior& prior, const Owned& owned,
                                         bool from_front) {
  Observation seen = view.observe(image, start, gate_px, prior, owned, from_front);
  const double whole = look_work({start.semi_major_px, start.semi_minor_px});
  work += seen.segment.area_px > 0 ? whole : kColorsAlone * whole;
  return seen;
}

// Validation gate of a measurement: share of the rim, jump from the prediction, change of the axes
// against their slow mean and against training, colors of the inside.
// False for a front that leaked too: its ellipse means nothing. `axes` are the slow mean, or the
// trained ones of a new object; `jump` in px; `inliers` a share.
bool ColorTracker::State::good(const Observation& seen, const Ellipse& start,
                               const Eigen::Vector2d& axes, double jump, double inliers) const {
  if (seen.leaked || !seen.measured || seen.measured->inlier_fraction < inliers) return false;
  const Ellipse& e = seen.measured->ellipse;
  if (!in_image(e) || (e.center_px - start.center_px).norm() > jump) return false;
  if (!within_share(e.semi_major_px, axes.x(), settings.axis_change)) return false;
  if (!within_share(e.semi_minor_px, axes.y(), settings.axis_change)) return false;
  const double size = size_of(e);
  if (size < settings.least_size || size > settings.most_size) return false;
  const Eigen::Vector2d trained = size * trained_axes();
  if (!within_share(e.semi_major_px, trained.x(), kMostAspect) ||
      !within_share(e.semi_minor_px, trained.y(), kMostAspect))
    return false;
  // Where the rim is hidden the inside may be too; a whole rim around ground is a crossing of
  // vessels.
  if (seen.measured->inlier_fraction > kJudgedRim && seen.against > settings.max_against)
    return false;
  return seen.support >= settings.min_support;
}

// As a look measures them, with the bias that training found.
Eigen::Vector2d ColorTracker::State::trained_axes() const {
  return model.semi_axes_px + (settings.view.refine ? model.rim : model.segment).semi_axes_px;
}

// Against the masks: the factor that both axes have in common.
double ColorTracker::State::size_of(const Ellipse& e) const {
  return std::sqrt(e.semi_major_px * e.semi_minor_px / trained_axes().prod());
}

// What looks of this kind were worth in training; of one without a rim nothing is known.
LookWorth ColorTracker::State::worth_of(const Observation& seen) const {
  if (!settings.view.refine || !seen.measured || model.looks.empty()) return {};
  return model.looks.worth(features_of(seen, size_of(seen.measured->ellipse)));
}

// Subtracts the mean bias of the axes found in training and adds the covariance of the rest, which
// the scatter along the rim does not contain; then the factors by which looks like this one erred
// more than they claimed; then what an axis unlike the last ones says: a vessel at one end of the
// rim lengthens the ellipse and moves its center by as much.
// Axes keep their order, as covariance and pose depend on which is which.
EllipseMeasurement ColorTracker::State::calibrated(const Judged& look) const {
  const Calibration& calibration = settings.view.refine ? model.rim : model.segment;
  const EllipseMeasurement& raw = *look.seen.measured;
  EllipseMeasurement result = raw;
  // What an outline that is no ellipse, and its shading, do to the axes grows with it.
  const Eigen::Vector2d bias = size_of(raw.ellipse) * calibration.semi_axes_px;
  result.ellipse.semi_major_px -= bias.x();
  result.ellipse.semi_minor_px =
      std::min(raw.ellipse.semi_minor_px - bias.y(), result.ellipse.semi_major_px);
  Eigen::Matrix<double, 5, 1> scale;
  scale << Eigen::Vector2d::Constant(std::sqrt(look.worth.center)),
      Eigen::Vector3d::Constant(std::sqrt(look.worth.shape));
  result.covariance =
      scale.asDiagonal() * (raw.covariance + calibration.covariance) * scale.asDiagonal();
  const Eigen::Vector2d excess = kOneEnd * (look.free_axes_px - axes_px);
  const double c = std::cos(raw.ellipse.angle);
  const double s = std::sin(raw.ellipse.angle);
  const Eigen::Matrix2d axes = (Eigen::Matrix2d() << c, -s, s, c).finished();
  const Eigen::Matrix2d squares = excess.cwiseAbs2().asDiagonal();
  result.covariance.topLeftCorner<2, 2>() += axes * squares * axes.transpose();
  result.covariance.block<2, 2>(2, 2) += squares;
  return result;
}

void ColorTracker::State::report(const cv::Mat& image, const Judged& look, Track& track) {
  believed = last;
  believed_axes_px = axes_px;
  agreed = 0;
  other_waits = true;
  ground.keep(image);
  state = TrackState::tracking;
  track.measured = calibrated(look);
  track.support = look.seen.support;
  track.area_px = look.seen.segment.area_px;
  track.iterations = look.seen.iterations;
  learn_light(image, look);
  if (!model.head.empty()) head_of(image, track);
}

// The end that is the head keeps its end while it is followed: the odds of the images add up, each
// for less than it claims, as what misleads one misleads the next. Between two images a tracker may
// have taken another body, or turned it: a small chance that bounds the odds.
void ColorTracker::State::head_of(const cv::Mat& image, Track& track) {
  const Ellipse& e = track.measured->ellipse;
  const double away = std::remainder(e.angle - heading, 2 * std::numbers::pi);
  heading = std::abs(away) < std::numbers::pi / 2
                ? e.angle
                : std::remainder(e.angle + std::numbers::pi, 2 * std::numbers::pi);
  Ellipse along = e;
  along.angle = heading;
  const double before = 1 / (1 + std::exp(-heading_odds));
  const double kept = before + kFlipped * (1 - 2 * before);
  heading_odds = std::log(kept / (1 - kept));
  // A hidden end says nothing.
  if (track.measured->inlier_fraction > kWholeRim)
    heading_odds += kHeadShare * model.head.log_odds(image, along);
  if (heading_odds < 0) {
    heading = std::remainder(heading + std::numbers::pi, 2 * std::numbers::pi);
    heading_odds = -heading_odds;
  }
  const double probability = 1 / (1 + std::exp(-heading_odds));
  if (probability < kSureHead) return;
  track.heading = Heading{heading, probability};
  track.tip = model.head.tip(image, *track.measured, heading);
}

// Only of a whole rim around the object's colors: what hides a part of it, or lies over it, has a
// light of its own.
void ColorTracker::State::learn_light(const cv::Mat& image, const Judged& look) {
  const Observation& seen = look.seen;
  if (!settings.adapt || !settings.view.refine) return;
  if (seen.measured->inlier_fraction < kSureRim || seen.support < kSureSupport ||
      seen.against > kSureAgainst)
    return;
  light.seen(model.light, image, seen.measured->ellipse);
}

// The model is taken over, since the view keeps a reference into it.
ColorTracker::ColorTracker(ObjectModel model, const ColorTrackerSettings& settings) {
  settings.check();
  require(!model.color.table().empty() && !model.shape.samples().empty(), "model: is not trained");
  state_ = std::make_unique<State>(std::move(model), settings);
}

ColorTracker::~ColorTracker() = default;

void ColorTracker::reset() {
  state_->state = TrackState::searching;
  state_->agreed = 0;
}

// The axes are the trained ones, not the operator's, whose outline is rough.
// As if it had been measured in the last frame: the next one is searched near there, with the gate
// of a tracked object.
void ColorTracker::place(const Ellipse& at) {
  State& s = *state_;
  require(s.in_image(at), "at: its center is not in the image");
  require(at.semi_minor_px > 1 && at.semi_major_px >= at.semi_minor_px &&
              std::isfinite(at.semi_major_px + at.angle),
          "at: its axes are not those of an ellipse");
  s.last = at;
  s.axes_px = s.trained_axes();
  s.velocity_px.setZero();
  s.turn = 0;
  s.growth = 0;
  s.unseen = 0;
  s.believed = at;
  s.believed_axes_px = s.axes_px;
  s.agreed = 0;
  s.ground.forget();
  s.heading_odds = 0;
  s.last_center_worth = s.last_shape_worth = 1;
  s.state = TrackState::tracking;
}

TrackState ColorTracker::state() const { return state_->state; }

const ObjectModel& ColorTracker::model() const { return state_->model; }

const TrackMemory& ColorTracker::memory() const { return *state_; }

// The next update() then behaves as it would have after that frame.
void ColorTracker::restore(const TrackMemory& memory) {
  static_cast<TrackMemory&>(*state_) = memory;
}

std::optional<Ellipse> ColorTracker::expected() const {
  if (state_->state == TrackState::searching && state_->agreed == 0) return std::nullopt;
  return state_->expected();
}

// tracking -> coasting for coast_frames, then lost; searching stays.
// `unseen` counts on while lost: the prediction stays where it was after three frames.
void ColorTracker::State::not_seen() {
  if (state == TrackState::searching) return;
  ++unseen;
  state = unseen > settings.coast_frames ? TrackState::lost : TrackState::coasting;
}

// For a frame that was measured and taken back: time goes on for the object.
Track ColorTracker::miss() {
  Track track;
  track.expected = expected();
  state_->drop_candidate();
  state_->not_seen();
  track.state = state_->state;
  return track;
}

// The light first. State machine: near the prediction while tracking or coasting; the frame in
// which coasting ends is searched as a whole already. Throws std::invalid_argument for another type
// or size. The measurement is present only while tracking; a prediction is never returned as a
// measurement.
Track ColorTracker::update(const cv::Mat& image, const Owned& owned) {
  State& s = *state_;
  require(image.type() == CV_8UC3, "image: must be 8-bit color (BGR)");
  require(image.size() == s.model.image_size, "image: its size differs from the training images'");
  require(owned.map.empty() || (owned.map.type() == CV_8UC1 && owned.map.size() == image.size()),
          "owned: must be 8-bit gray of the image's size");
  Track track;
  track.self_measured = s.settings.view.refine;
  s.work = 0;
  s.ground.next();
  if (s.settings.adapt) s.light.next(s.model.light, image);
  track.light = s.light.gains();
  s.view.set_light(track.light);
  const bool followed = s.state == TrackState::tracking || s.state == TrackState::coasting;
  bool found = (followed || s.agreed > 0) && s.near_expected(image, owned, s.asked_near(), track);
  if (!found && followed) found = s.near_expected_displaced(image, owned, track);
  // In a spot of light the object's own may be neither the one that was learnt nor the ground's.
  // Not in a frame that is searched as a whole anyway, unless the light jumped: its time is
  // bounded.
  if (!found && followed && s.settings.adapt &&
      (s.light.jumped() || s.unseen < s.settings.coast_frames))
    found = s.near_expected_relit(image, owned, track);
  if (!found) s.drop_candidate();
  if (!found && followed) s.not_seen();
  if (!found && (s.state == TrackState::searching || s.state == TrackState::lost))
    found = s.anywhere(image, owned, track);
  track.state = s.state;
  track.work = s.work;
  return track;
}

}  // namespace vitreo::vision
