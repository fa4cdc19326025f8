// SPDX-License-Identifier: Apache-2.0
#include "vision/multi_tracker.h"

#include "vision/evidence.h"
#include "vision/preconditions.h"

#include <opencv2/core.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>
#include <utility>

namespace vitreo::vision {
namespace {

constexpr double kHalo = 2.0;      // px around an ellipse that belong to it too: its blur
constexpr double kTouching = 5.0;  // px between rims: nearer objects are measured twice
// Share of the smaller ellipse within another from which both are the same body.
constexpr double kSameBody = 0.35;
constexpr double kAlike = 0.25;  // share of common colors from which two objects are alike
constexpr int kSureF = static_cast<int>(ColorModel::kScale);  // F = 1: for the object by e to one
// Of an axis, relative: a tracker takes no body beyond it for its own (ColorTracker's kMostSize).
constexpr double kSameSize = 0.35;
// A lost object counts as found again where it is this many times nearer to its own last position
// than to that of any other lost one alike.
constexpr double kNearer = 2.0;

// Signed distance to the rim to first order, (g - 1) / |grad g| with g = sqrt(x^2 / a^2 + y^2 /
// b^2) (Taubin 1991), px, negative inside; c and s: the ellipse's cosine and sine.
// Exact on the rim and good near it, which is where it decides between two objects.
double rim_distance(const Ellipse& e, double c, double s, double u, double v) {
  const double du = u - e.center_px.x();
  const double dv = v - e.center_px.y();
  const double x = c * du + s * dv;
  const double y = c * dv - s * du;
  const double a2 = e.semi_major_px * e.semi_major_px;
  const double b2 = e.semi_minor_px * e.semi_minor_px;
  const double level = std::sqrt(x * x / a2 + y * y / b2);
  const double slope = std::sqrt(x * x / (a2 * a2) + y * y / (b2 * b2));
  return slope > 0 ? (level - 1) * level / slope : -e.semi_minor_px;
}

// Share of the smaller ellipse that lies in the other, by 64 samples of equal area on Vogel's
// (1979) spiral: radii sqrt((q + 1/2) / n), steps of the golden angle.
// Sampled, as the common area of two ellipses has no simple closed form.
double shared_area(const Ellipse& one, const Ellipse& other) {
  const bool swap =
      one.semi_major_px * one.semi_minor_px > other.semi_major_px * other.semi_minor_px;
  const Ellipse& small = swap ? other : one;
  const Ellipse& large = swap ? one : other;
  const double c = std::cos(large.angle);
  const double s = std::sin(large.angle);
  int inside = 0;
  constexpr int kSamples = 64;
  for (int q = 0; q < kSamples; ++q) {
    const double r = std::sqrt((q + 0.5) / kSamples);
    const Eigen::Vector2d p =
        Ellipse{small.center_px, r * small.semi_major_px, r * small.semi_minor_px, small.angle}
            .point(2.399963 * q);
    inside += rim_distance(large, c, s, p.x(), p.y()) < 0;
  }
  return static_cast<double>(inside) / kSamples;
}

// Whether any of 32 rim points of one is nearer than kTouching to the other's rim, or inside.
// 0.19635 is a 32nd of a turn.
bool touching(const Ellipse& one, const Ellipse& other) {
  if ((one.center_px - other.center_px).norm() >
      one.semi_major_px + other.semi_major_px + kTouching)
    return false;
  const double c = std::cos(other.angle);
  const double s = std::sin(other.angle);
  for (int k = 0; k < 32; ++k) {
    const Eigen::Vector2d p = one.point(0.19635 * k);
    if (rim_distance(other, c, s, p.x(), p.y()) < kTouching) return true;
  }
  return false;
}

// Of the colors sure for the object with fewer of them, the share that is sure for the other too.
// By the tables, once at the start: what is alike there cannot be told apart by color in any image.
double common_colors(const ColorModel& one, const ColorModel& other) {
  int first = 0;
  int second = 0;
  int both = 0;
  for (std::size_t i = 0; i < one.table().size(); ++i) {
    const bool a = one.table()[i] > kSureF;
    const bool b = other.table()[i] > kSureF;
    first += a, second += b, both += a && b;
  }
  return static_cast<double>(both) / std::max(std::min(first, second), 1);
}

// Whether one's tracker could take the other's body for its own by its axes.
bool common_size(const ObjectModel& one, const ObjectModel& other) {
  const auto within = [](const Eigen::Vector2d& axes, const Eigen::Vector2d& of) {
    return ((axes - of).cwiseAbs().array() <= kSameSize * of.array()).all();
  };
  return within(one.semi_axes_px, other.semi_axes_px) ||
         within(other.semi_axes_px, one.semi_axes_px);
}

}  // namespace

struct MultiTracker::State {
  // What the multi-tracker knows of an object beyond its tracker.
  struct Object {
    explicit Object(const TrackedObject& from) : tracker(from.model, from.settings) {}
    ColorTracker tracker;
    TrackMemory before;            // state before this frame
    std::optional<Ellipse> claim;  // ellipse of the pixels it owns now
    double confidence = 0;         // inlier fraction of the last frame
    cv::Rect painted;              // of the map
  };

  bool alike(std::size_t i, std::size_t j) const { return alike_[i * order.size() + j]; }
  TrackedObject audited(TrackedObject object, std::size_t k) const;
  void clear();
  void paint();
  void paint_one(std::size_t k);
  void sort_by_confidence();
  void measure(std::size_t k, const cv::Mat& image);
  void measure_touching_again(const cv::Mat& image);
  bool believable(std::size_t k) const;
  void resolve_overlaps();
  void take_back(std::size_t k);

  std::vector<std::unique_ptr<Object>> objects;
  std::vector<bool> alike_;
  std::vector<std::size_t> order;
  std::vector<Track> tracks;
  std::vector<bool> again;
  cv::Mat map;
};

void MultiTracker::State::clear() {
  for (auto& object : objects) {
    if (!object->painted.empty()) map(object->painted).setTo(0);
    object->painted = {};
  }
}

// Marks the pixels within kHalo of the claim and nearer to it than to every other claim: a Voronoi
// diagram of the ellipses; of two at the same distance the first has the pixel.
// Only objects that touch are compared, as all others are farther away than the halo.
void MultiTracker::State::paint_one(std::size_t k) {
  const Ellipse wide = grown(*objects[k]->claim, kHalo);
  const int reach = static_cast<int>(wide.semi_major_px) + 2;
  const cv::Rect box(static_cast<int>(wide.center_px.x()) - reach,
                     static_cast<int>(wide.center_px.y()) - reach, 2 * reach + 1, 2 * reach + 1);
  objects[k]->painted = box & cv::Rect({0, 0}, map.size());
  std::array<std::size_t, kMostObjects> rivals{};
  std::size_t count = 0;
  for (std::size_t j = 0; j < objects.size(); ++j)
    if (j != k && objects[j]->claim && touching(wide, *objects[j]->claim)) rivals[count++] = j;
  const Ellipse& own = *objects[k]->claim;
  const double c = std::cos(own.angle);
  const double s = std::sin(own.angle);
  for (int v = objects[k]->painted.y; v < objects[k]->painted.br().y; ++v) {
    const RowSpan span = row_of(wide, v);
    auto* row = map.ptr<unsigned char>(v);
    for (int u = std::max(span.first, 0); u < std::min(span.end, map.cols); ++u) {
      const double distance = count > 0 ? rim_distance(own, c, s, u, v) : 0;
      bool nearest = true;
      for (std::size_t q = 0; q < count && nearest; ++q) {
        const Ellipse& other = *objects[rivals[q]]->claim;
        const double theirs =
            rim_distance(other, std::cos(other.angle), std::sin(other.angle), u, v);
        nearest = distance < theirs || (distance == theirs && k < rivals[q]);
      }
      if (nearest) row[u] = static_cast<unsigned char>(k + 1);
    }
  }
}

// What answered the audit of an object may have been another one alike, which its training images
// show as well: position tells those apart, not likeness.
TrackedObject MultiTracker::State::audited(TrackedObject object, std::size_t k) const {
  for (std::size_t j = 0; j < order.size(); ++j)
    if (alike(k, j)) object.model.audit = {};
  return object;
}

// Maps all claims anew. Only what was painted is cleared, not the whole map.
void MultiTracker::State::paint() {
  clear();
  for (std::size_t k = 0; k < objects.size(); ++k)
    if (objects[k]->claim) paint_one(k);
}

// Tracked before coasting before lost, then by inlier fraction: the surer objects claim pixels
// first.
// Ties go to the earlier object, so that the same images give the same order.
void MultiTracker::State::sort_by_confidence() {
  for (std::size_t k = 0; k < order.size(); ++k) order[k] = k;
  const auto rank = [this](std::size_t k) {
    const TrackState state = objects[k]->tracker.state();
    const double base = state == TrackState::tracking ? 3 : (state == TrackState::coasting ? 2 : 1);
    // What is about to be believed comes before what is still searched.
    const double candidate = objects[k]->tracker.memory().agreed > 0 ? 0.5 : 0;
    return base + candidate + 0.4 * objects[k]->confidence;
  };
  std::sort(order.begin(), order.end(), [&](std::size_t i, std::size_t j) {
    const double a = rank(i);
    const double b = rank(j);
    return a > b || (a == b && i < j);
  });
}

// Identity of an object found anew: false where it may as well be another one of like colors that
// is missing too.
// Between two lost objects alike, a body counts only for one that is clearly nearer to it
// (kNearer); else neither takes it, and it may be clear in a later frame.
bool MultiTracker::State::believable(std::size_t k) const {
  const Object& object = *objects[k];
  const bool anew =
      object.before.state == TrackState::lost || object.before.state == TrackState::searching;
  if (!anew || !tracks[k].measured) return true;
  const Eigen::Vector2d& at = tracks[k].measured->ellipse.center_px;
  const bool known = object.before.state == TrackState::lost;
  for (std::size_t j = 0; j < objects.size(); ++j) {
    if (j == k || !alike(k, j)) continue;
    const TrackMemory& other = objects[j]->before;
    if (other.state == TrackState::searching || other.state == TrackState::tracking) continue;
    if (!known) return false;  // the missing one was tracked before: it takes precedence
    const double own = (at - object.before.believed.center_px).norm();
    const double theirs = (at - other.believed.center_px).norm();
    if (kNearer * own > theirs) return false;
  }
  return true;
}

// Undoes this frame for an object and counts it as missed.
// Time goes on for it: a frame that is taken back is a frame without a measurement.
void MultiTracker::State::take_back(std::size_t k) {
  objects[k]->tracker.restore(objects[k]->before);
  tracks[k] = objects[k]->tracker.miss();
  objects[k]->claim.reset();
  objects[k]->confidence = 0;
}

// Tracks one object with the others' pixels blocked, and renews its claim.
// The map is painted anew at once, since the next object is measured against it.
void MultiTracker::State::measure(std::size_t k, const cv::Mat& image) {
  Object& object = *objects[k];
  tracks[k] = object.tracker.update(image, {map, static_cast<unsigned char>(k + 1)});
  if (!believable(k)) {
    take_back(k);
  } else if (tracks[k].measured) {
    object.claim = object.tracker.memory().last;
    object.confidence = tracks[k].measured->inlier_fraction;
  } else if (tracks[k].candidate) {
    // A body beside it that is searched too would be taken together with it for one.
    object.claim = tracks[k].candidate;
    object.confidence = 0;
  } else {
    object.claim.reset();
    object.confidence = 0;
  }
  paint();
}

// Second pass for objects that touch: their common border now comes from this frame's ellipses
// instead of the predicted ones.
// From the state before this frame, so that the frame counts once.
void MultiTracker::State::measure_touching_again(const cv::Mat& image) {
  std::fill(again.begin(), again.end(), false);
  for (std::size_t i = 0; i < objects.size(); ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      if (objects[i]->claim && objects[j]->claim &&
          touching(*objects[i]->claim, *objects[j]->claim))
        again[i] = again[j] = true;
    }
  }
  for (const std::size_t k : order) {
    if (!again[k]) continue;
    objects[k]->tracker.restore(objects[k]->before);
    measure(k, image);
  }
}

// Two objects on one body: of different colors the surer one keeps it; of like colors neither, as
// it cannot be decided.
// Runs after both passes: only then is each claim final.
void MultiTracker::State::resolve_overlaps() {
  for (std::size_t i = 0; i < objects.size(); ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      if (!objects[i]->claim || !objects[j]->claim) continue;
      if (tracks[i].candidate || tracks[j].candidate) continue;  // neither is believed yet
      if (shared_area(*objects[i]->claim, *objects[j]->claim) < kSameBody) continue;
      const bool first_is_surer = objects[i]->confidence > objects[j]->confidence;
      if (alike(i, j) || !first_is_surer) take_back(i);
      if (alike(i, j) || first_is_surer) take_back(j);
    }
  }
}

// Throws std::invalid_argument naming the objects. All sizes are fixed here, so that update()
// allocates nothing later.
MultiTracker::MultiTracker(const std::vector<TrackedObject>& objects)
    : state_(std::make_unique<State>()) {
  require(!objects.empty() && objects.size() <= kMostObjects,
          "objects: must be 1 to " + std::to_string(kMostObjects));
  State& s = *state_;
  for (const TrackedObject& one : objects)
    require(one.model.image_size == objects[0].model.image_size,
            "objects: their models are for images of different sizes");
  s.order.resize(objects.size());
  s.alike_.resize(objects.size() * objects.size());
  for (std::size_t i = 0; i < objects.size(); ++i)
    for (std::size_t j = 0; j < objects.size(); ++j)
      s.alike_[i * objects.size() + j] =
          i != j && common_size(objects[i].model, objects[j].model) &&
          common_colors(objects[i].model.color, objects[j].model.color) > kAlike;
  for (std::size_t k = 0; k < objects.size(); ++k)
    s.objects.push_back(std::make_unique<State::Object>(s.audited(objects[k], k)));
  s.tracks.resize(objects.size());
  s.again.resize(objects.size());
}

MultiTracker::~MultiTracker() = default;

// Claims by prediction, one pass in the order of confidence, a second one for objects that touch,
// then the overlaps.
// Only tracked objects, and those about to be believed, claim pixels by prediction: that of a
// coasting or lost one would mask a body that is really there.
const std::vector<Track>& MultiTracker::update(const cv::Mat& image) {
  State& s = *state_;
  if (s.map.size() != image.size()) {
    s.map = cv::Mat::zeros(image.size(), CV_8UC1);
    for (auto& object : s.objects) object->painted = {};
  }
  s.sort_by_confidence();
  for (auto& object : s.objects) {
    object->before = object->tracker.memory();
    object->claim.reset();
    if (object->before.state == TrackState::tracking || object->before.agreed > 0)
      object->claim = object->tracker.expected();
  }
  s.paint();
  for (const std::size_t k : s.order) s.measure(k, image);
  s.measure_touching_again(image);
  s.resolve_overlaps();
  s.paint();
  return s.tracks;
}

void MultiTracker::place(std::size_t object, const Ellipse& at) {
  if (object >= state_->objects.size()) throw std::out_of_range("object: there is no such one");
  state_->objects[object]->tracker.place(at);
}

void MultiTracker::reset() {
  for (auto& object : state_->objects) object->tracker.reset();
}

const cv::Mat& MultiTracker::owners() const { return state_->map; }

bool MultiTracker::alike(std::size_t one, std::size_t other) const {
  if (one >= state_->objects.size() || other >= state_->objects.size())
    throw std::out_of_range("object: there is no such one");
  return state_->alike(one, other);
}

}  // namespace vitreo::vision
