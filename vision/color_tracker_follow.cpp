// Where the object is expected: one measurement at the prediction, and what it does to motion and
// size.
// SPDX-License-Identifier: Apache-2.0
#include "vision/color_tracker_state.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

namespace vitreo::vision {
namespace {

constexpr double kAxesGain = 0.03;  // share of a new measurement in the slow mean of the axes
// Of the size that both axes share, an alpha-beta filter (gains of scale and of its change): a zoom
// of one percent a frame is followed without lag.
constexpr double kScaleGain = 0.1;
constexpr double kGrowthGain = 0.005;
constexpr double kMostGrowth = 0.03;
constexpr double kVelocityGain = 0.6;  // share of the last step in the velocity
constexpr double kAxesSigma = 1.0;     // px, of semi-axes against their slow mean
// Excess of one axis over the other's in one image from which something continues the object's rim,
// relative: then it is measured again with its axes held, to which standard deviation (relative
// too): of 64 normals a looser one is overruled.
constexpr double kSudden = 0.06;
constexpr double kHeldAxes = 0.003;
// Of the one axis' excess the other's, from which both have grown alike.
constexpr double kAlike = 0.7;
// A center that is not known to this share of the short semi-axis is none.
constexpr double kVaguest = 1.0 / 6;
// Of a view that was displaced: what finding that out costs, in looks at the trained size, and what
// is less than it takes to lose an object by.
constexpr double kDisplacedWork = 2.0;
constexpr double kLeastJump_px = 6;
constexpr double kCenterSigma = 5.0;  // px, of the predicted center

}  // namespace

// Constant velocity and turn rate, for three frames at most: while coasting longer the prediction
// stays where it is.
// Angles are modulo pi, as an ellipse has no head.
Ellipse ColorTracker::State::expected() const {
  const double frames = std::min(unseen + 1, 3);
  const double grown = std::exp(frames * growth);
  Ellipse e{last.center_px + frames * velocity_px, grown * axes_px.x(), grown * axes_px.y(),
            last.angle + frames * turn};
  e.angle = std::remainder(e.angle, std::numbers::pi);
  return e;
}

// Motion and axes by first-order low-pass filters, x <- (1 - g) x + g new; the velocity is per
// frame, over the frames since the last measurement.
void ColorTracker::State::follow(const Ellipse& e, double inliers) {
  const double frames = unseen + 1;
  const Eigen::Vector2d step = (e.center_px - last.center_px) / frames;
  const double turned = std::remainder(e.angle - last.angle, std::numbers::pi) / frames;
  velocity_px = step + (1 - kVelocityGain) * (velocity_px - step);
  turn = std::clamp(turned + (1 - kVelocityGain) * (turn - turned), -0.15, 0.15);
  axes_px *= std::exp(std::min(frames, 3.0) * growth);
  // A half hidden object's axes are those of the prior: they carry no information.
  if (inliers > 0.7) {
    const double larger = std::log(e.semi_major_px * e.semi_minor_px / axes_px.prod()) / 2;
    axes_px *= std::exp(kScaleGain * larger);
    growth = std::clamp(growth + kGrowthGain * larger / frames, -kMostGrowth, kMostGrowth);
    axes_px += kAxesGain * (Eigen::Vector2d(e.semi_major_px, e.semi_minor_px) - axes_px);
  }
  last = e;
  unseen = 0;
}

// A measurement near `start` that passes the gates; gate, jump and prior widen with every frame
// without one.
bool ColorTracker::State::look_near(const cv::Mat& image, const Owned& owned, const Ellipse& start,
                                    bool from_front, double inliers, Judged& look) {
  // px, by which the position is less certain.
  const double more = settings.coast_px * std::min(unseen, settings.coast_frames);
  const EllipsePrior prior{start, kCenterSigma + more, kAxesSigma,
                           settings.view.angle_sigma + 0.03 * unseen};
  look.seen = observe(image, start, settings.view.gate_px + more, prior, owned, from_front);
  if (!good(look.seen, start, axes_px, settings.jump_px + more, inliers)) return false;
  const Ellipse& e = look.seen.measured->ellipse;
  look.free_axes_px = {e.semi_major_px, e.semi_minor_px};
  look.worth = worth_of(look.seen);
  if (settings.view.refine) hold_axes(image, owned, start, look);
  return true;
}

// A vessel, or a shadow in a weak light, that continues one end of the rim lengthens the ellipse
// all at once, and moves its center by about as much; the front has it in it too, so that the rim
// is searched where it was expected. With the axes as they were the normals there are outliers,
// which the fit leaves out. By what both axes have grown alike the body itself has: a zoom is ahead
// of the slow mean, and one that is held as small as that is lost. What the axes were without it
// stays in the covariance and in their slow mean, so that a body that does change is followed.
void ColorTracker::State::hold_axes(const cv::Mat& image, const Owned& owned, const Ellipse& start,
                                    Judged& look) {
  const Eigen::Array2d excess =
      (look.free_axes_px.array() / Eigen::Array2d(start.semi_major_px, start.semi_minor_px)).log();
  const double both = std::max(excess.minCoeff(), 0.0);
  const double alike = both > kAlike * excess.maxCoeff() ? both : 0;
  if (excess.maxCoeff() < alike + kSudden) return;
  if (!affords(look_work(axes_px))) return;
  Ellipse as_it_was = start;
  as_it_was.semi_major_px *= std::exp(alike);
  as_it_was.semi_minor_px *= std::exp(alike);
  const double more = settings.coast_px * std::min(unseen, settings.coast_frames);
  const EllipsePrior prior{as_it_was, kCenterSigma + more, kHeldAxes * axes_px.y(),
                           settings.view.angle_sigma + 0.03 * unseen};
  constexpr bool kFromFront = false;
  const Observation held =
      observe(image, as_it_was, settings.view.gate_px + more, prior, owned, kFromFront);
  if (!good(held, start, axes_px, settings.jump_px + more, settings.min_inliers)) return;
  // Whether it is the object the free look says as well; a held rim with something at it is unlike.
  // One that says nothing of the center is no better than the free one, whose excess is in the
  // covariance.
  Judged instead{held, worth_of(held), look.free_axes_px};
  instead.worth.likeness = std::max(instead.worth.likeness, look.worth.likeness);
  if (!vague(instead)) look = std::move(instead);
}

// What makes looks err lasts for some images, and what sixteen looks in memory say of one scatters:
// a look that claims to be much better than the last one is believed by half (geometric mean); one
// that claims to be worse, at once.
void ColorTracker::State::weigh_with_last(LookWorth& worth) {
  const LookWorth now = worth;
  worth.center = std::max(now.center, std::sqrt(now.center * last_center_worth));
  worth.shape = std::max(now.shape, std::sqrt(now.shape * last_shape_worth));
  last_center_worth = now.center;
  last_shape_worth = now.shape;
}

// Of a look with a rim: by what it says itself, its center may be anywhere in a good part of the
// object.
bool ColorTracker::State::vague(const Judged& look) const {
  if (!settings.view.refine) return false;
  const double variance = calibrated(look).covariance.topLeftCorner<2, 2>().trace() / 2;
  // Blur makes it larger, and no more certain.
  return std::sqrt(variance) > kVaguest * std::min(axes_px.y(), trained_axes().y());
}

ColorTracker::State::Asked ColorTracker::State::asked_near() const {
  return {settings.min_inliers, agreed > 0 ? settings.min_likeness_new : settings.min_likeness};
}

// One measurement at the prediction.
// `track.expected` is set whether it is found or not, so that the operator sees where it is
// searched.
bool ColorTracker::State::near_expected(const cv::Mat& image, const Owned& owned,
                                        const Asked& asked, Track& track) {
  const Ellipse start = expected();
  track.expected = start;
  if (!in_image(start)) return false;
  // A vessel may have led the front astray: then the rim is searched at the prediction instead.
  for (const bool from_front : {true, false}) {
    if (!affords(look_work(axes_px))) break;
    Judged look;
    if (!look_near(image, owned, start, from_front, asked.inliers, look)) continue;
    track.likeness = look.worth.likeness;
    if (track.likeness < asked.likeness || vague(look)) continue;
    weigh_with_last(look.worth);
    Ellipse followed = look.seen.measured->ellipse;
    followed.semi_major_px = look.free_axes_px.x();
    followed.semi_minor_px = look.free_axes_px.y();
    follow(followed, look.seen.measured->inlier_fraction);
    if (agreed > 0)
      confirm(image, look, track);
    else
      report(image, look, track);
    return true;
  }
  return false;
}

// The view was displaced, and the object with it: looked at where the ground has taken it, and as
// much is asked as of one found anew. What the ground does while the object is where it was, or
// where nothing is seen, changes nothing.
bool ColorTracker::State::near_expected_displaced(const cv::Mat& image, const Owned& owned,
                                                  Track& track) {
  if (!affords(kDisplacedWork + look_work(axes_px))) return false;
  work += kDisplacedWork;
  const auto jump = ground.jump_to(image);
  if (!jump || jump->norm() < kLeastJump_px) return false;
  const TrackMemory before = *this;
  ground.forget();
  last.center_px += *jump;
  Track there = track;
  if (near_expected(image, owned, {settings.min_inliers_new, settings.min_likeness_new}, there)) {
    track = there;
    return true;
  }
  static_cast<TrackMemory&>(*this) = before;
  return false;
}

// The object is where it was expected to be, in another one of the lights that it may have now. In
// an image that is searched as a whole next, a search and two looks are kept for that.
bool ColorTracker::State::near_expected_relit(const cv::Mat& image, const Owned& owned,
                                              Track& track) {
  const LightMemory::Guesses guesses = light.guesses(model.light);
  const bool searched_next = unseen >= settings.coast_frames;
  for_search = searched_next ? search_work(axes_px) + 2 * look_work(axes_px) : 0;
  bool found = false;
  for (std::size_t k = 1; k < guesses.count && !found; ++k) {
    view.set_light(guesses.gains[k]);
    found = near_expected(image, owned, asked_near(), track);
    if (!found) continue;
    light.take(guesses.gains[k]);
    track.light = guesses.gains[k];
  }
  for_search = 0;
  if (!found) view.set_light(track.light);
  return found;
}

}  // namespace vitreo::vision
