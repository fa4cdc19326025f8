// Where the object is not, or not yet: the search of the image, and what it takes to be believed.
// SPDX-License-Identifier: Apache-2.0
#include "vision/color_tracker_state.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace vitreo::vision {
namespace {

// Sizes that are searched besides the known one, in turn.
constexpr std::array<double, 5> kSizes{0.7, 1.4, 0.5, 2.0, 1.0};
// Of a search of 640 x 480 px for an object of kSearched_px semi-minor axis, in looks at the
// trained size; cells are as wide as the object is thin, of 2 px at least, of 8 px at most.
constexpr double kSearchWork = 0.8;
constexpr double kSearched_px = 15;
constexpr double kLeastSearchWork = 0.3;
constexpr double kMostSearchWork = 1.8;
constexpr int kLooksEach = 2;        // at a candidate
constexpr double kOtherSize = 0.22;  // natural logarithm, from which a size is another one
constexpr double kSameSize = 0.05;   // and below which a search need not be done twice
// A measurement from a rough position that ends this near to it (px) with this inlier fraction
// needs no second one.
constexpr double kRough = 4.0;
constexpr double kSure = 0.8;
// Correlation of the picture where something was found, then and now, from which nothing has left
// that place.
constexpr double kUnchanged = 0.9;

}  // namespace

// The audit asks for the trained size and for the others apart: what has the one size on a ground
// need not have another.
const FalseBelief::Asked& ColorTracker::State::asked_of(const Ellipse& e) const {
  return std::abs(std::log(size_of(e))) < kOtherSize ? model.audit.as_trained : model.audit.resized;
}

// There is no step from the last position that could be a velocity. Found again, the object keeps
// the shape of its slow mean and has the size of the find, since a zoom goes on while it is lost;
// of one never seen, or of another size altogether, the mean starts here.
void ColorTracker::State::find(const cv::Mat& image, const Observation& seen) {
  const Ellipse& e = seen.measured->ellipse;
  velocity_px.setZero();
  turn = 0;
  growth = 0;
  const double larger = std::log(e.semi_major_px * e.semi_minor_px / axes_px.prod()) / 2;
  if (state == TrackState::searching || std::abs(larger) > kOtherSize)
    axes_px = {e.semi_major_px, e.semi_minor_px};
  else if (std::abs(larger) > kSameSize)
    axes_px *= std::exp(larger);
  last = e;
  unseen = 0;
  ground.forget();
  found_px = e.center_px;
  heading_odds = 0;
  last_center_worth = last_shape_worth = 1;
  found_reach_px = e.semi_major_px;
  found_doubtful = false;
  found_ground = GroundRing(image, e);
  found_place = place_found(image);
}

// Where it was found: circles that cross the rim of an object of that size. What has nothing to
// tell there has no rim.
GroundRing ColorTracker::State::place_found(const cv::Mat& image) const {
  const double thin = found_reach_px * trained_axes().y() / trained_axes().x();
  return {image, found_px, thin};
}

// Against the ground: what stands still on a ground that stands still, or moves with one that
// moves, may be a part of it. Rings are of one radius, or they are of different ground. A part of
// the ground that has no outline of its own is looked at here and there, in one size and another,
// over pixels that stay as they are.
bool ColorTracker::State::moved(const cv::Mat& image, const Judged& look) const {
  const double sigma = std::sqrt(calibrated(look).covariance.topLeftCorner<2, 2>().trace() / 2);
  const Eigen::Vector2d& now = look.seen.measured->ellipse.center_px;
  if ((now - found_px).norm() <= std::max(settings.moved_px, 4 * sigma)) return false;
  if (!found_place.tells() || found_place.same_ground(place_found(image), kUnchanged)) return false;
  return !found_ground.same_ground(GroundRing(image, {now, found_reach_px, 1, 0}));
}

// One more frame agrees with a new find. It is believed when enough do, and, of a ground that the
// audit saw taken for the object, when nothing else is nearly as like it, or it moves as no part of
// the ground does.
void ColorTracker::State::confirm(const cv::Mat& image, const Judged& look, Track& track) {
  ++agreed;
  const FalseBelief::Asked& asked = asked_of(look.seen.measured->ellipse);
  margin = std::min(margin, look.worth.likeness - asked.most_likeness);
  track.margin = margin;
  // A look at a part of the ground may grow out of the size for which the audit took it.
  found_doubtful = found_doubtful || asked.answered > 0;
  const bool sure = !found_doubtful || margin > settings.sure_margin;
  if (agreed >= settings.confirm_frames && (sure || moved(image, look)))
    report(image, look, track);
  else
    track.candidate = last;
}

// As if it had never been found: the object is still where it was believed last.
void ColorTracker::State::drop_candidate() {
  if (agreed == 0) return;
  agreed = 0;
  last = believed;
  axes_px = believed_axes_px;
  growth = 0;
  velocity_px.setZero();
  turn = 0;
}

// The pixels that are read decide.
double ColorTracker::State::search_work(const Eigen::Vector2d& axes) const {
  return std::clamp(kSearchWork * kSearched_px / axes.y(), kLeastSearchWork, kMostSearchWork);
}

// A candidate of the search, measured: twice at most, from the rough position, then from the first
// result, and not beyond what `reserve` leaves of the image's work. The prior is wide, as the
// candidate's position is good to some px and its angle to some tenths of rad. Nothing is measured
// where it is no object.
// More is asked of an object found anew (min_inliers_new) than of one followed: the whole image has
// more that looks like it.
void ColorTracker::State::look_at(const cv::Mat& image, const Owned& owned, Ellipse start,
                                  const Eigen::Vector2d& axes, double reserve, Observation& seen) {
  start.semi_major_px = axes.x();
  start.semi_minor_px = axes.y();
  for (int round = 0; round < kLooksEach && in_image(start); ++round) {
    if (!affords(look_work({start.semi_major_px, start.semi_minor_px}) + reserve)) break;
    const EllipsePrior prior{start, 8, 2.5, 0.4};
    seen = observe(image, start, settings.view.gate_px, prior, owned);
    if (!seen.measured) return;
    const bool near = (seen.measured->ellipse.center_px - start.center_px).norm() < kRough;
    start = seen.measured->ellipse;
    if (near && seen.measured->inlier_fraction > kSure) break;
  }
  if (!good(seen, start, axes, settings.jump_px, settings.min_inliers_new)) seen.measured.reset();
}

// The candidates of the search under one guess of the light and of the size, as long as the image's
// work leaves `reserve`; the best of all guesses stays. The first candidate is looked at in every
// image, the others begin with another one in each, so that all have their turn.
void ColorTracker::State::search_in(const LogColor& gains, const Eigen::Vector2d& axes,
                                    double reserve, const cv::Mat& image, const Owned& owned) {
  const Eigen::Vector2d middle(image.cols / 2.0, image.rows / 2.0);
  const bool known = state != TrackState::searching;
  work += search_work(axes);
  search_source->set_light(gains);
  search.set_size(axes);
  view.set_light(gains);
  const std::vector<Ellipse>& found =
      search.find(image, *search_source, known ? last.center_px : middle, settings.candidates,
                  owned.map, owned.self);
  const std::size_t others = found.empty() ? 0 : found.size() - 1;
  for (std::size_t k = 0; k < found.size(); ++k) {
    const std::size_t at = k == 0 ? 0 : 1 + (k - 1 + searches) % others;
    if (!affords(look_work(axes) + reserve)) break;
    Judged look;
    look_at(image, owned, found[at], axes, reserve, look.seen);
    if (!look.seen.measured) continue;
    const Ellipse& e = look.seen.measured->ellipse;
    look.free_axes_px = {e.semi_major_px, e.semi_minor_px};
    look.worth = worth_of(look.seen);
    pick_from(look, gains);
  }
}

// Two looks at one body, by two guesses, are one candidate.
void ColorTracker::State::pick_from(const Judged& look, const LogColor& gains) {
  const double likeness = look.worth.likeness;
  if (pick.best) {
    const double of_best = pick.best->worth.likeness;
    const Eigen::Vector2d apart =
        look.seen.measured->ellipse.center_px - pick.best->seen.measured->ellipse.center_px;
    if (apart.norm() >= model.semi_axes_px.y())
      pick.second = std::max(pick.second, std::min(likeness, of_best));
    if (likeness <= of_best) return;
  }
  pick.best = look;
  pick.gains = gains;
}

// What the object may be besides as it was: in another light, or of another size, in turn; a size
// that is about the known one is none. `axes`: those it is known by.
std::optional<ColorTracker::State::Way> ColorTracker::State::other_way(
    const Eigen::Vector2d& axes) {
  const LightMemory::Guesses guesses = light.guesses(model.light);
  const std::size_t lights = settings.adapt ? guesses.count - 1 : 0;
  const std::size_t ways = lights + (settings.any_size ? 1 : 0);
  if (ways == 0) return std::nullopt;
  std::size_t way = size_turn % ways;
  if (way < lights) return Way{guesses.gains[way + 1], axes, false};
  Eigen::Vector2d other = kSizes[size_turn / ways % kSizes.size()] * trained_axes();
  if (std::abs(std::log(other.y() / axes.y())) < kSameSize) {
    size_turn += static_cast<unsigned>(ways);
    other = kSizes[size_turn / ways % kSizes.size()] * trained_axes();
  }
  return Way{guesses.gains[0], other, true};
}

// Re-detection, in the light as it was and, where that finds nothing like the object, in one other
// way. Both share what the image's work leaves (kMostWork), which bounds its time: in the first
// image that is searched, and after one that left nothing for the other way, a search and a look of
// it are kept for it, beyond what the first place of the known way asks for. What an image that was
// followed until now leaves may be too little for any search: then the next one is searched. The
// candidate most like the object in training is the find, and by how much it is more so than the
// second is its margin.
bool ColorTracker::State::anywhere(const cv::Mat& image, const Owned& owned, Track& track) {
  const Eigen::Vector2d axes = state == TrackState::searching ? trained_axes() : axes_px;
  if (!affords(search_work(axes) + look_work(axes))) return false;
  pick.best.reset();
  pick.second = model.audit.as_trained.most_likeness;
  const std::optional<Way> other = other_way(axes);
  const double of_other = other ? search_work(other->axes) + look_work(other->axes) : 0;
  const bool both = affords(search_work(axes) + kLooksEach * look_work(axes) + of_other);
  search_in(light.guesses(model.light).gains[0], axes, other_waits && both ? of_other : 0, image,
            owned);
  ++searches;
  const bool none = !pick.best || pick.best->worth.likeness < settings.min_likeness_new;
  other_waits = none && other && !affords(of_other);
  if (none && other && !other_waits) {
    ++size_turn;
    if (other->resized) pick.second = std::max(pick.second, model.audit.resized.most_likeness);
    search_in(other->gains, other->axes, 0, image, owned);
  }
  if (!pick.best) return false;
  track.likeness = pick.best->worth.likeness;
  if (track.likeness < settings.min_likeness_new) return false;
  light.take(pick.gains);
  find(image, pick.best->seen);
  margin = pick.best->worth.likeness - pick.second;
  agreed = 0;
  confirm(image, *pick.best, track);
  return true;
}

}  // namespace vitreo::vision
