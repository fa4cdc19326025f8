// SPDX-License-Identifier: Apache-2.0
#include "vision/color_tracker.h"

#include "vision/object_search.h"
#include "vision/preconditions.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <utility>

namespace vitreo::vision {
namespace {

constexpr double kAxesGain = 0.03;  // share of a new measurement in the slow mean of the axes
// Of the size that both axes share, an alpha-beta filter (gains of scale and of its change): a zoom
// of one percent a frame is followed without lag.
constexpr double kScaleGain = 0.05;
constexpr double kGrowthGain = 0.00125;
constexpr double kMostGrowth = 0.03;
constexpr double kVelocityGain = 0.6;  // share of the last step in the velocity
constexpr double kMostAspect = 0.35;   // of an axis against the masks' at the same size, relative
// Sizes that are searched besides the known one, in turn.
constexpr std::array<double, 5> kSizes{0.7, 1.4, 0.5, 2.0, 1.0};
// What a frame's search may cost, in looks at a candidate; a search of the image costs as much as
// one for an object of kOneLook_px semi-minor axis, and more where it has smaller cells.
constexpr int kFrameWork = 9;
constexpr double kOneLook_px = 15;
constexpr int kMostSearchWork = 4;
constexpr int kLooksEach = 2;        // at a candidate
constexpr double kOtherSize = 0.22;  // natural logarithm, from which a size is another one
constexpr double kAxesSigma = 1.0;   // px, of semi-axes against their slow mean
// Of an axis' excess over its slow mean, the standard deviation that it stands for in the center:
// what lengthens an axis moves one end of it.
constexpr double kOneEnd = 0.4;
// Excess of an axis in one image from which something continues the object's rim, relative: then it
// is measured again with its axes held, to which standard deviation (relative too). A body changes
// by a percent an image, and a slow mean follows that.
constexpr double kSudden = 0.06;
constexpr double kHeldAxes = 0.01;
// A center that is not known to this share of the short semi-axis is none.
constexpr double kVaguest = 1.0 / 6;
// Inlier fraction above which the rim is visible enough for its inside to be judged.
constexpr double kJudgedRim = 0.45;
// A measurement from a rough position that ends this near to it (px) with this inlier fraction
// needs no second one.
constexpr double kRough = 4.0;
constexpr double kSure = 0.8;
// Correlation of the picture where something was found, then and now, from which nothing has left
// that place.
constexpr double kUnchanged = 0.9;
constexpr double kCenterSigma = 5.0;  // px, of the predicted center
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

bool within_share(double value, double mean, double share) {
  return std::abs(value - mean) <= share * mean;
}

// Cells are as wide as the object is thin.
int search_work(const Eigen::Vector2d& axes) {
  const double cells = kOneLook_px / axes.y();
  return std::clamp(static_cast<int>(std::lround(cells * cells)), 1, kMostSearchWork);
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

// All that changes from frame to frame is in TrackMemory, so that a frame can be undone by
// restoring it (MultiTracker).
struct ColorTracker::State : TrackMemory {
  // A look with what it is worth, for which the memory is asked once.
  struct Judged {
    Observation seen;
    LookWorth worth;
    Eigen::Vector2d free_axes_px{0, 0};  // as they were measured before they were held
  };
  State(ObjectModel learnt, const ColorTrackerSettings& chosen)
      : model(std::move(learnt)),
        settings(chosen),
        view(model, settings.view),
        search_source(evidence_source(model)),
        search({{0, 0}, model.semi_axes_px.x(), model.semi_axes_px.y(), 0}) {}

  Ellipse expected() const;
  bool near_expected(const cv::Mat& image, const Owned& owned, Track& track);
  bool near_expected_relit(const cv::Mat& image, const Owned& owned, Track& track);
  bool anywhere(const cv::Mat& image, const Owned& owned, Track& track);
  int search_in(const LogColor& gains, const Eigen::Vector2d& axes, int looks, const cv::Mat& image,
                const Owned& owned);
  Eigen::Vector2d trained_axes() const;
  double size_of(const Ellipse& e) const;
  const FalseBelief::Asked& asked_of(const Ellipse& e) const;
  bool good(const Observation& seen, const Ellipse& start, const Eigen::Vector2d& axes, double jump,
            double inliers) const;
  LookWorth worth_of(const Observation& seen) const;
  bool look_near(const cv::Mat& image, const Owned& owned, const Ellipse& start, bool from_front,
                 Judged& look);
  void hold_axes(const cv::Mat& image, const Owned& owned, const Ellipse& start, bool from_front,
                 Judged& look);
  bool vague(const Judged& look) const;
  void weigh_with_last(LookWorth& worth);
  int look_at(const cv::Mat& image, const Owned& owned, Ellipse start, const Eigen::Vector2d& axes,
              int looks, Observation& seen);
  void follow(const Ellipse& e, double inliers);
  void find(const cv::Mat& image, const Observation& seen);
  void confirm(const cv::Mat& image, const Judged& look, Track& track);
  bool moved(const cv::Mat& image, const Judged& look) const;
  GroundRing place_found(const cv::Mat& image) const;
  void drop_candidate();
  bool in_image(const Ellipse& e) const;
  void report(const cv::Mat& image, const Judged& look, Track& track);
  EllipseMeasurement calibrated(const Judged& look) const;
  void learn_light(const cv::Mat& image, const Judged& look);
  void head_of(const cv::Mat& image, Track& track);
  void not_seen();

  ObjectModel model;
  ColorTrackerSettings settings;
  ObjectView view;
  std::unique_ptr<EvidenceSource> search_source;
  ObjectSearch search;
  struct {
    std::optional<Judged> best;
    LogColor gains = LogColor::Zero();
    double second = 0;  // likeness of the next best, elsewhere
  } pick;               // of one image's search
};

// The center decides: an object half out of the image is still tracked by the rim that is left.
bool ColorTracker::State::in_image(const Ellipse& e) const {
  return e.center_px.allFinite() && e.center_px.x() >= 0 && e.center_px.y() >= 0 &&
         e.center_px.x() <= model.image_size.width - 1 &&
         e.center_px.y() <= model.image_size.height - 1;
}

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

// The audit asks for the trained size and for the others apart: what has the one size on a ground
// need not have another.
const FalseBelief::Asked& ColorTracker::State::asked_of(const Ellipse& e) const {
  return std::abs(std::log(size_of(e))) < kOtherSize ? model.audit.as_trained : model.audit.resized;
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

// There is no step from the last position that could be a velocity. Found again, the object keeps
// its slow mean of the axes; of one never seen the mean starts here.
void ColorTracker::State::find(const cv::Mat& image, const Observation& seen) {
  const Ellipse& e = seen.measured->ellipse;
  velocity_px.setZero();
  turn = 0;
  growth = 0;
  if (state == TrackState::searching || std::abs(std::log(size_of(e) / size_of(last))) > kOtherSize)
    axes_px = {e.semi_major_px, e.semi_minor_px};
  last = e;
  unseen = 0;
  found_px = e.center_px;
  heading_odds = 0;
  last_center_worth = last_shape_worth = 1;
  found_reach_px = e.semi_major_px;
  found_doubtful = false;
  found_ground = GroundRing(image, e);
  found_place = place_found(image);
}

void ColorTracker::State::report(const cv::Mat& image, const Judged& look, Track& track) {
  believed = last;
  believed_axes_px = axes_px;
  agreed = 0;
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

// A measurement near `start` that passes the gates; gate, jump and prior widen with every frame
// without one.
bool ColorTracker::State::look_near(const cv::Mat& image, const Owned& owned, const Ellipse& start,
                                    bool from_front, Judged& look) {
  // px, by which the position is less certain.
  const double more = settings.coast_px * std::min(unseen, settings.coast_frames);
  const EllipsePrior prior{start, kCenterSigma + more, kAxesSigma,
                           settings.view.angle_sigma + 0.03 * unseen};
  look.seen = view.observe(image, start, settings.view.gate_px + more, prior, owned, from_front);
  if (!good(look.seen, start, axes_px, settings.jump_px + more, settings.min_inliers)) return false;
  const Ellipse& e = look.seen.measured->ellipse;
  look.free_axes_px = {e.semi_major_px, e.semi_minor_px};
  look.worth = worth_of(look.seen);
  if (settings.view.refine) hold_axes(image, owned, start, from_front, look);
  return true;
}

// A vessel, or a shadow in a weak light, that continues one end of the rim lengthens the ellipse
// all at once, and moves its center by about as much. With the axes as they were the normals there
// are outliers, which the fit leaves out. What the axes were without it stays in the covariance and
// in their slow mean, so that a body that does change is followed.
void ColorTracker::State::hold_axes(const cv::Mat& image, const Owned& owned, const Ellipse& start,
                                    bool from_front, Judged& look) {
  if (((look.free_axes_px - axes_px).array() < kSudden * axes_px.array()).all()) return;
  const double more = settings.coast_px * std::min(unseen, settings.coast_frames);
  const EllipsePrior prior{start, kCenterSigma + more, kHeldAxes * axes_px.y(),
                           settings.view.angle_sigma + 0.03 * unseen};
  const Observation held =
      view.observe(image, start, settings.view.gate_px + more, prior, owned, from_front);
  if (!good(held, start, axes_px, settings.jump_px + more, settings.min_inliers)) return;
  // Whether it is the object the free look says as well; a held rim with something at it is unlike.
  const double likeness = look.worth.likeness;
  look.seen = held;
  look.worth = worth_of(held);
  look.worth.likeness = std::max(look.worth.likeness, likeness);
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
  return std::sqrt(variance) > kVaguest * axes_px.y();
}

// One measurement at the prediction.
// `track.expected` is set whether it is found or not, so that the operator sees where it is
// searched.
bool ColorTracker::State::near_expected(const cv::Mat& image, const Owned& owned, Track& track) {
  const Ellipse start = expected();
  track.expected = start;
  if (!in_image(start)) return false;
  const bool is_candidate = agreed > 0;
  const double likeness = is_candidate ? settings.min_likeness_new : settings.min_likeness;
  // A vessel may have led the front astray: then the rim is searched at the prediction instead.
  for (const bool from_front : {true, false}) {
    Judged look;
    if (!look_near(image, owned, start, from_front, look)) continue;
    track.likeness = look.worth.likeness;
    if (track.likeness < likeness || vague(look)) continue;
    weigh_with_last(look.worth);
    Ellipse followed = look.seen.measured->ellipse;
    followed.semi_major_px = look.free_axes_px.x();
    followed.semi_minor_px = look.free_axes_px.y();
    follow(followed, look.seen.measured->inlier_fraction);
    if (is_candidate)
      confirm(image, look, track);
    else
      report(image, look, track);
    return true;
  }
  return false;
}

// The object is where it was expected to be, in another one of the lights that it may have now.
bool ColorTracker::State::near_expected_relit(const cv::Mat& image, const Owned& owned,
                                              Track& track) {
  const LightMemory::Guesses guesses = light.guesses(model.light);
  for (std::size_t k = 1; k < guesses.count; ++k) {
    view.set_light(guesses.gains[k]);
    if (!near_expected(image, owned, track)) continue;
    light.take(guesses.gains[k]);
    track.light = guesses.gains[k];
    return true;
  }
  view.set_light(track.light);
  return false;
}

// A candidate of the search, measured: twice at most, from the rough position, then from the first
// result. The prior is wide, as the candidate's position is good to some px and its angle to some
// tenths of rad. Returns how often it was looked at; nothing is measured where it is no object.
// More is asked of an object found anew (min_inliers_new) than of one followed: the whole image has
// more that looks like it.
int ColorTracker::State::look_at(const cv::Mat& image, const Owned& owned, Ellipse start,
                                 const Eigen::Vector2d& axes, int looks, Observation& seen) {
  start.semi_major_px = axes.x();
  start.semi_minor_px = axes.y();
  int round = 0;
  while (round < std::min(looks, kLooksEach) && in_image(start)) {
    const EllipsePrior prior{start, 8, 2.5, 0.4};
    seen = view.observe(image, start, settings.view.gate_px, prior, owned);
    ++round;
    if (!seen.measured) return round;
    const bool near = (seen.measured->ellipse.center_px - start.center_px).norm() < kRough;
    start = seen.measured->ellipse;
    if (near && seen.measured->inlier_fraction > kSure) break;
  }
  if (!good(seen, start, axes, settings.jump_px, settings.min_inliers_new)) seen.measured.reset();
  return round;
}

// The candidates of the search under one guess of the light and of the size, as long as there are
// looks left; the best of all guesses stays. Two looks at one body, by two guesses, are one
// candidate. Returns the looks that are left.
int ColorTracker::State::search_in(const LogColor& gains, const Eigen::Vector2d& axes, int looks,
                                   const cv::Mat& image, const Owned& owned) {
  const Eigen::Vector2d middle(image.cols / 2.0, image.rows / 2.0);
  const bool known = state != TrackState::searching;
  search_source->set_light(gains);
  search.set_size(axes);
  view.set_light(gains);
  for (const Ellipse& start : search.find(image, *search_source, known ? last.center_px : middle,
                                          settings.candidates, owned.map, owned.self)) {
    if (looks <= 0) break;
    Judged look;
    looks -= look_at(image, owned, start, axes, looks, look.seen);
    if (!look.seen.measured) continue;
    const Ellipse& e = look.seen.measured->ellipse;
    look.free_axes_px = {e.semi_major_px, e.semi_minor_px};
    look.worth = worth_of(look.seen);
    const double likeness = look.worth.likeness;
    if (!pick.best) {
      pick.best = look;
      pick.gains = gains;
      continue;
    }
    const double of_best = pick.best->worth.likeness;
    const bool same =
        (look.seen.measured->ellipse.center_px - pick.best->seen.measured->ellipse.center_px)
            .norm() < model.semi_axes_px.y();
    if (!same) pick.second = std::max(pick.second, std::min(likeness, of_best));
    if (likeness <= of_best) continue;
    pick.best = look;
    pick.gains = gains;
  }
  return looks;
}

// Re-detection, in the light as it was and, where that finds nothing like the object, in one more
// way a frame, which bounds a frame's time: the other lights that it may be, and another size, in
// turn. The candidate most like the object in training is the find, and by how much it is more so
// than the second is its margin.
bool ColorTracker::State::anywhere(const cv::Mat& image, const Owned& owned, Track& track) {
  pick.best.reset();
  pick.second = model.audit.as_trained.most_likeness;
  const Eigen::Vector2d axes = state == TrackState::searching ? trained_axes() : axes_px;
  const LightMemory::Guesses guesses = light.guesses(model.light);
  const std::size_t lights = settings.adapt ? guesses.count - 1 : 0;
  const std::size_t ways = lights + (settings.any_size ? 1 : 0);
  const std::size_t way = ways > 0 ? size_turn % ways : 0;
  const bool resized = way >= lights;
  const double size = ways > 0 && resized ? kSizes[size_turn / ways % kSizes.size()] : 1;
  const Eigen::Vector2d other = resized ? Eigen::Vector2d(size * trained_axes()) : axes;
  const int reserve = ways > 0 ? search_work(other) + kLooksEach : 0;
  const int looks = std::max(kFrameWork - search_work(axes) - reserve, kLooksEach);
  const int left = search_in(guesses.gains[0], axes, looks, image, owned);
  const bool none = !pick.best || pick.best->worth.likeness < settings.min_likeness_new;
  if (none && ways > 0) {
    ++size_turn;
    if (resized) pick.second = std::max(pick.second, model.audit.resized.most_likeness);
    search_in(guesses.gains[resized ? 0 : way + 1], other, left + kLooksEach, image, owned);
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
  s.axes_px = s.model.semi_axes_px;
  s.velocity_px.setZero();
  s.turn = 0;
  s.growth = 0;
  s.unseen = 0;
  s.believed = at;
  s.believed_axes_px = s.axes_px;
  s.agreed = 0;
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
  if (s.settings.adapt) s.light.next(s.model.light, image);
  track.light = s.light.gains();
  s.view.set_light(track.light);
  const bool followed = s.state == TrackState::tracking || s.state == TrackState::coasting;
  bool found = (followed || s.agreed > 0) && s.near_expected(image, owned, track);
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
  return track;
}

}  // namespace vitreo::vision
