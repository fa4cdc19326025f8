// SPDX-License-Identifier: Apache-2.0
#include "vision/look_training.h"

#include "vision/color_tracker.h"
#include "vision/disturbance.h"
#include "vision/object_search.h"
#include "vision/object_view.h"

#include <Eigen/LU>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <numbers>
#include <optional>
#include <vector>

namespace vitreo::vision {
namespace {

constexpr std::size_t kMostImages = 12;  // evenly of all: more show nothing new
constexpr int kMargin_px = 40;    // of the part of an image that is disturbed, round the object
constexpr double kAstray_px = 8;  // a look that ends farther off is at something else
constexpr int kPlaces = 16;       // looked at besides the search's candidates
constexpr std::array<double, 4> kSizes{0.5, 0.7, 1.4, 2.0};  // of the object besides its own
constexpr int kResized = 3;                                  // looks at it in each
constexpr int kPlacesResized = 6;
constexpr int kMoves = 14;          // places of the ground to which the object is moved
constexpr double kMisjudged = 0.4;  // of the light, natural logarithm
constexpr unsigned char kMaskedOut = 1;
constexpr unsigned char kSelf = 2;

struct Erred {
  double center;  // squared Mahalanobis distances
  double shape;
  double off_px;
};

// Of a look that is calibrated as the tracker does it.
Erred error_of(const EllipseMeasurement& raw, const Calibration& known, const Ellipse& truth,
               double size) {
  Eigen::Matrix<double, 5, 1> error = raw.ellipse.vector() - truth.vector();
  error.segment<2>(2) -= size * known.semi_axes_px;
  error[4] = std::remainder(error[4], std::numbers::pi);
  const Eigen::Matrix<double, 5, 5> covariance = raw.covariance + known.covariance;
  const Eigen::Vector2d center = error.head<2>();
  const Eigen::Vector3d shape = error.tail<3>();
  return {center.dot(covariance.topLeftCorner<2, 2>().inverse() * center),
          shape.dot(covariance.bottomRightCorner<3, 3>().inverse() * shape), center.norm()};
}

// Where a tracker may expect the object: some pixels and some degrees beside.
Ellipse expected_near(const Ellipse& truth, const Eigen::Vector2d& axes, cv::RNG& random) {
  Ellipse e{truth.center_px + Eigen::Vector2d(random.gaussian(2.5), random.gaussian(2.5)), axes.x(),
            axes.y(), truth.angle + random.gaussian(0.06)};
  return e;
}

// The part of an image round the object, which is what a look reads.
cv::Rect around(const Ellipse& truth, double gate_px, const cv::Size& size) {
  const int reach = static_cast<int>(truth.semi_major_px + gate_px) + kMargin_px;
  return cv::Rect(static_cast<int>(truth.center_px.x()) - reach,
                  static_cast<int>(truth.center_px.y()) - reach, 2 * reach, 2 * reach) &
         cv::Rect({0, 0}, size);
}

class Lessons {
 public:
  Lessons(const ObjectModel& model, const ObjectViewSettings& settings)
      : model_(model),
        settings_(refined(settings)),
        view_(model, settings_),
        source_(evidence_source(model)),
        search_({{0, 0}, model.semi_axes_px.x(), model.semi_axes_px.y(), 0}) {}

  // Looks at one image under every disturbance, and at the object moved to other places of its
  // ground, some of them disturbed as well.
  void at_object(LookMemory& memory, const KnownObject& one, std::uint64_t seed) {
    cv::RNG random(seed + 77);
    const cv::Rect part = around(one.truth, settings_.gate_px, one.labeled.image.size());
    Ellipse truth = one.truth;
    truth.center_px -= Eigen::Vector2d(part.x, part.y);
    for (int kind = 0; kind < kDisturbances; ++kind)
      look_at_object(memory, disturbed(one.labeled.image(part), truth, kind, seed), truth, random,
                     kind);
    for (int move = 0; move < kMoves; ++move) {
      const cv::Mat image = moved(one, part, random);
      const int kind = move % 2 == 0 ? 0 : random.uniform(1, kDisturbances);
      look_at_object(memory, disturbed(image, truth, kind, seed + 31 * move), truth, random, kind);
    }
    for (const double size : kSizes) {
      cv::Mat image;
      cv::resize(one.labeled.image(part), image, {}, size, size,
                 size < 1 ? cv::INTER_AREA : cv::INTER_CUBIC);
      // Of the centers of pixels: half a pixel before the first one begins the image.
      Ellipse resized{size * (truth.center_px.array() + 0.5).matrix() - Eigen::Vector2d(0.5, 0.5),
                      size * truth.semi_major_px, size * truth.semi_minor_px, truth.angle};
      for (int look = 0; look < kResized; ++look) {
        const int kind = look == 0 ? 0 : random.uniform(1, kDisturbances);
        look_at_object(memory, disturbed(image, resized, kind, seed + 57 * look), resized, random,
                       kind);
      }
    }
  }

  // Looks at the same image's anatomy: what the search brings, and places at random, in several
  // lights, out of focus, and with the light misjudged.
  void at_anatomy(LookMemory& memory, const KnownObject& one, std::uint64_t seed) {
    cv::RNG random(seed + 991);
    const Owned owned{masked_out(one.labeled.mask), kSelf};
    struct Lesson {
      int kind;
      double gain;  // natural logarithm, by which the light is taken to differ
    };
    for (const auto& [kind, gain] : {Lesson{0, 0}, Lesson{1, 0}, Lesson{3, 0}, Lesson{11, 0},
                                     Lesson{0, kMisjudged}, Lesson{0, -kMisjudged}}) {
      const cv::Mat image = disturbed(one.labeled.image, one.truth, kind, seed);
      view_.set_light(LogColor::Constant(gain));
      source_->set_light(LogColor::Constant(gain));
      std::vector<Ellipse> places =
          search_.find(image, *source_, Eigen::Vector2d(image.cols / 2.0, image.rows / 2.0), 8,
                       owned.map, owned.self);
      for (int k = 0; k < kPlaces; ++k)
        places.push_back({{random.uniform(0.0, 1.0) * (image.cols - 1),
                           random.uniform(0.0, 1.0) * (image.rows - 1)},
                          0,
                          0,
                          random.uniform(0.0, CV_PI)});
      for (const Ellipse& place : places) look_at(memory, image, place, 1, owned);
    }
    at_anatomy_resized(memory, one, owned, random);
    view_.set_light(LogColor::Zero());
    source_->set_light(LogColor::Zero());
  }

  // For the object in other sizes, in the light as it is.
  void at_anatomy_resized(LookMemory& memory, const KnownObject& one, const Owned& owned,
                          cv::RNG& random) {
    const cv::Mat& image = one.labeled.image;
    view_.set_light(LogColor::Zero());
    source_->set_light(LogColor::Zero());
    for (const double size : kSizes) {
      search_.set_size(size * model_.semi_axes_px);
      std::vector<Ellipse> places =
          search_.find(image, *source_, Eigen::Vector2d(image.cols / 2.0, image.rows / 2.0), 6,
                       owned.map, owned.self);
      for (int k = 0; k < kPlacesResized; ++k)
        places.push_back({{random.uniform(0.0, 1.0) * (image.cols - 1),
                           random.uniform(0.0, 1.0) * (image.rows - 1)},
                          0,
                          0,
                          random.uniform(0.0, CV_PI)});
      for (const Ellipse& place : places) look_at(memory, image, place, size, owned);
    }
    search_.set_size(model_.semi_axes_px);
  }

  static cv::Mat masked_out(const cv::Mat& mask) {
    cv::Mat map;
    cv::dilate(mask != 0, map, cv::getStructuringElement(cv::MORPH_ELLIPSE, {9, 9}));
    map.setTo(kMaskedOut, map);
    return map;
  }

 private:
  static ObjectViewSettings refined(ObjectViewSettings settings) {
    settings.refine = true;
    return settings;
  }

  // Of a kind that is light alone, the tracker would have learnt it; see it so.
  void look_at_object(LookMemory& memory, const cv::Mat& image, const Ellipse& truth,
                      cv::RNG& random, int kind) {
    const auto color = is_light(kind) ? log_color_within(image, truth) : std::nullopt;
    view_.set_light(color && model_.light.known ? LogColor(*color - model_.light.object)
                                                : LogColor::Zero());
    Eigen::Vector2d axes = Eigen::Vector2d(truth.semi_major_px, truth.semi_minor_px) +
                           size_of(truth) * model_.rim.semi_axes_px;
    // Blur widens the object, and what is expected of it in the next image; not by gray levels,
    // where what it mixes is computed (GrayEvidence).
    const int looks = is_blur(kind) && !model_.gray.known ? 2 : 1;
    cv::RNG again(random);  // so that the lessons to come are as if there were one look
    for (int look = 0; look < looks; ++look) {
      const Ellipse start = expected_near(truth, axes, look == 0 ? random : again);
      const EllipsePrior prior{start, 5, 1, settings_.angle_sigma};
      const Observation seen = view_.observe(image, start, settings_.gate_px, prior);
      if (!seen.measured || seen.leaked) return;
      remember(memory, seen, truth);
      axes = {seen.measured->ellipse.semi_major_px, seen.measured->ellipse.semi_minor_px};
    }
  }

  void remember(LookMemory& memory, const Observation& seen, const Ellipse& truth) const {
    const Ellipse& e = seen.measured->ellipse;
    const Eigen::Vector2d trained = model_.semi_axes_px + model_.rim.semi_axes_px;
    const LookFeatures features =
        features_of(seen, std::sqrt(e.semi_major_px * e.semi_minor_px / trained.prod()));
    const Erred erred = error_of(*seen.measured, model_.rim, truth, size_of(truth));
    if (erred.off_px < kAstray_px)
      memory.add_object(features, erred.center, erred.shape);
    else
      memory.add_other(features);
  }

  // The object with a little of what is round it (its blur), cut out and laid over another part of
  // the same image, as large as `part`.
  static cv::Mat moved(const KnownObject& one, const cv::Rect& part, cv::RNG& random) {
    const cv::Mat& image = one.labeled.image;
    cv::Mat place;
    const cv::Rect there(random.uniform(0, image.cols - part.width + 1),
                         random.uniform(0, image.rows - part.height + 1), part.width, part.height);
    image(there).convertTo(place, CV_32FC3);
    cv::Mat share;
    cv::Mat object;
    cv::dilate(one.labeled.mask(part) != 0, share,
               cv::getStructuringElement(cv::MORPH_ELLIPSE, {3, 3}));
    share.convertTo(share, CV_32F, 1.0 / 255);
    cv::GaussianBlur(share, share, {0, 0}, 1.2);
    cv::merge(std::vector<cv::Mat>(3, share), share);
    image(part).convertTo(object, CV_32FC3);
    cv::Mat result = object.mul(share) + place.mul(cv::Scalar::all(1) - share);
    result.convertTo(result, CV_8UC3);
    return result;
  }

  // Of a true ellipse, against the masks.
  double size_of(const Ellipse& truth) const {
    return std::sqrt(truth.semi_major_px * truth.semi_minor_px / model_.semi_axes_px.prod());
  }

  // For the object in `size` times its own.
  void look_at(LookMemory& memory, const cv::Mat& image, Ellipse start, double size,
               const Owned& owned) {
    const Eigen::Vector2d axes = size * (model_.semi_axes_px + model_.rim.semi_axes_px);
    start.semi_major_px = axes.x();
    start.semi_minor_px = axes.y();
    const Eigen::Vector2d limit(image.cols - 1, image.rows - 1);
    for (int round = 0; round < 2; ++round) {
      if ((start.center_px.array() < 0).any() || (start.center_px.array() > limit.array()).any())
        return;
      const Observation seen =
          view_.observe(image, start, settings_.gate_px, {start, 8, 2.5, 0.4}, owned);
      if (!seen.measured || seen.leaked) return;
      const Ellipse& e = seen.measured->ellipse;
      const double trained = axes.prod() / (size * size);
      memory.add_other(features_of(seen, std::sqrt(e.semi_major_px * e.semi_minor_px / trained)));
      start = e;
    }
  }

  const ObjectModel& model_;
  ObjectViewSettings settings_;
  ObjectView view_;
  std::unique_ptr<EvidenceSource> source_;  // of the search
  ObjectSearch search_;
};

std::vector<KnownObject> some_of(std::span<const KnownObject> images) {
  std::vector<KnownObject> chosen;
  const std::size_t count = std::min(images.size(), kMostImages);
  for (std::size_t k = 0; k < count; ++k) chosen.push_back(images[k * images.size() / count]);
  return chosen;
}

// What each image teaches, by itself: no lesson depends on another's.
std::vector<LookMemory> lessons_of(const ObjectModel& model, std::span<const KnownObject> images,
                                   const ObjectViewSettings& view) {
  Lessons lessons(model, view);
  std::vector<LookMemory> memories(images.size());
  for (std::size_t k = 0; k < images.size(); ++k) {
    lessons.at_object(memories[k], images[k], k);
    lessons.at_anatomy(memories[k], images[k], k);
  }
  return memories;
}

// Of all images, or without every second one from `left_out`, which are for the audit.
LookMemory memory_of(std::span<const LookMemory> memories, int left_out = -1) {
  LookMemory memory;
  for (std::size_t k = 0; k < memories.size(); ++k)
    if (left_out < 0 || static_cast<int>(k % 2) != left_out) memory.append(memories[k]);
  return memory;
}

void count(FalseBelief::Asked& asked, const Track& track) {
  asked.most_likeness = std::max(asked.most_likeness, track.likeness);
  asked.answered += track.measured.has_value();
}

// Each half is asked by a tracker that knows the anatomy of the other half alone.
FalseBelief audit_of(ObjectModel model, std::span<const KnownObject> images,
                     std::span<const LookMemory> memories, const ObjectViewSettings& view) {
  FalseBelief audit;
  for (const int part : {0, 1}) {
    if (images.size() > 1) model.looks = memory_of(memories, part);
    ColorTrackerSettings settings;
    settings.view = view;
    settings.confirm_frames = 1;
    settings.any_size = false;
    ColorTracker tracker(model, settings);
    settings.any_size = true;
    ColorTracker resized(model, settings);
    for (std::size_t k = static_cast<std::size_t>(part); k < images.size(); k += 2) {
      const Owned owned{Lessons::masked_out(images[k].labeled.mask), kSelf};
      tracker.reset();
      const Track track = tracker.update(images[k].labeled.image, owned);
      ++audit.asked;
      count(audit.as_trained, track);
      if (track.measured) audit.places_px.push_back(track.measured->ellipse.center_px);
      // Each frame searches one more size; the one of most likeness speaks for the image.
      Track most;
      for (std::size_t turn = 0; turn < kSizes.size() + 1; ++turn) {
        resized.reset();
        const Track other = resized.update(images[k].labeled.image, owned);
        if (!most.measured && (other.measured || other.likeness > most.likeness)) most = other;
      }
      if (!track.measured) count(audit.resized, most);
    }
  }
  return audit;
}

}  // namespace

// The memory is for looks with a refined rim; without one a look has no measure of itself.
void learn_looks(ObjectModel& model, std::span<const KnownObject> images,
                 const ObjectViewSettings& view) {
  const std::vector<KnownObject> chosen = some_of(images);
  const std::vector<LookMemory> memories = lessons_of(model, chosen, view);
  model.audit = audit_of(model, chosen, memories, view);
  model.looks = memory_of(memories);
}

}  // namespace vitreo::vision
