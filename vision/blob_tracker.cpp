// SPDX-License-Identifier: Apache-2.0
#include "vision/blob_tracker.h"

#include "vision/blob_search.h"
#include "vision/contour.h"

#include <cmath>
#include <stdexcept>
#include <utility>

namespace vitreo::vision {
namespace {

void require(bool good, const char* what) {
  if (!good) throw std::invalid_argument(what);
}

constexpr int kNearStep = 2, kFarStep = 4;  // px between the pixels that are looked at
constexpr double kGrowth = 1.6;  // of the region, when the robot is not in it or sticks out
constexpr double kAlike =
    0.06;  // of an axis: by more it does not change from one image to the next
constexpr double kMostlySeen =
    0.5;  // of the rim: so much of it must be in line to be taken for the same robot

bool alike(const Ellipse& a, const Ellipse& b) {
  return std::abs(a.semi_major_px / b.semi_major_px - 1) < kAlike &&
         std::abs(a.semi_minor_px / b.semi_minor_px - 1) < kAlike;
}

}  // namespace

void BlobTrackerSettings::check() const {
  require(min_semi_minor_px >= 3, "min_semi_minor_px: must be at least 3");
  require(std::isfinite(max_semi_major_px) && max_semi_major_px > min_semi_minor_px,
          "max_semi_major_px: must be above min_semi_minor_px");
  require(std::isfinite(threshold_sigma) && threshold_sigma >= 3,
          "threshold_sigma: must be at least 3");
  require(min_contrast >= 1 && min_contrast <= 255, "min_contrast: must be 1 to 255 gray levels");
  require(normals >= 16 && normals <= 1024 && normals % 4 == 0,
          "normals: must be 16 to 1024, a multiple of 4");
  require(search_px >= 3 && search_px <= 16, "search_px: must be 3 to 16");
  require(blur_sigma_px >= 0.5 && blur_sigma_px <= 5, "blur_sigma_px: must be 0.5 to 5");
}

struct BlobTracker::State {
  State(Background learnt, const BlobTrackerSettings& chosen)
      : background(std::move(learnt)),
        settings(chosen),
        search(background, {settings.min_semi_minor_px, settings.max_semi_major_px,
                            settings.threshold_sigma, settings.min_contrast}),
        contour({settings.normals, settings.search_px, settings.blur_sigma_px,
                 settings.min_contrast}) {}

  std::optional<EllipseMeasurement> measure(const cv::Mat& image, const Ellipse& start);
  std::optional<EllipseMeasurement> near_last(const cv::Mat& image);
  std::optional<EllipseMeasurement> as_due(const cv::Mat& image);
  std::optional<EllipseMeasurement> of_blob(const cv::Mat& image, const Ellipse& blob);
  std::optional<EllipseMeasurement> anywhere(const cv::Mat& image);

  Background background;
  BlobTrackerSettings settings;
  BlobSearch search;
  Contour contour;
  std::optional<Ellipse> last;
  Eigen::Vector2d velocity_px{0, 0};  // per image
};

std::optional<EllipseMeasurement> BlobTracker::State::measure(const cv::Mat& image,
                                                              const Ellipse& start) {
  auto found = contour.measure(image, background.mean(), background.noise_of_level(), start);
  if (!found || found->contrast < settings.min_contrast) return std::nullopt;
  const Ellipse& e = found->ellipse;
  const cv::Rect2d frame(0, 0, image.cols, image.rows);
  if (!frame.contains({e.center_px.x(), e.center_px.y()})) return std::nullopt;
  if (e.semi_minor_px < settings.min_semi_minor_px || e.semi_major_px > settings.max_semi_major_px)
    return std::nullopt;
  return found;
}

/// The robot as it was, where it is due.
std::optional<EllipseMeasurement> BlobTracker::State::as_due(const cv::Mat& image) {
  Ellipse due = *last;
  due.center_px += velocity_px;
  auto found = measure(image, due);
  if (!found || found->inlier_fraction < kMostlySeen || !alike(found->ellipse, *last))
    return std::nullopt;
  return found;
}

/// What drifts up to the robot makes one blob with it, whose ellipse is neither's: from there the
/// fit ends beside the rim. From where the robot is due its own rim is found, and what hides a part
/// of that falls out of line.
std::optional<EllipseMeasurement> BlobTracker::State::of_blob(const cv::Mat& image,
                                                              const Ellipse& blob) {
  const auto found = measure(image, blob);
  if (found && alike(found->ellipse, *last)) return found;
  const auto due = as_due(image);
  return due ? due : found;
}

// The region follows the prediction and grows until it holds all of what it found.
std::optional<EllipseMeasurement> BlobTracker::State::near_last(const cv::Mat& image) {
  const Eigen::Vector2d center = last->center_px + velocity_px;
  const cv::Rect frame(0, 0, image.cols, image.rows);
  double half = last->semi_major_px + 2 * settings.search_px + velocity_px.norm();
  for (int k = 0; k < 4; ++k, half *= kGrowth) {
    const int size = 2 * static_cast<int>(half);
    const cv::Rect where = cv::Rect(static_cast<int>(center.x()) - size / 2,
                                    static_cast<int>(center.y()) - size / 2, size, size) &
                           frame;
    if (where.width < 8 || where.height < 8) break;
    const auto blob = search.largest(image, where, kNearStep);
    if (blob && !blob->cut) return of_blob(image, blob->ellipse);
  }
  return as_due(image);
}

std::optional<EllipseMeasurement> BlobTracker::State::anywhere(const cv::Mat& image) {
  const auto blob = search.largest(image, cv::Rect(0, 0, image.cols, image.rows), kFarStep);
  return blob ? measure(image, blob->ellipse) : std::nullopt;
}

BlobTracker::BlobTracker(Background background, const BlobTrackerSettings& settings) {
  settings.check();
  if (background.count() == 0) throw std::invalid_argument("background: has learnt no image");
  state_ = std::make_unique<State>(std::move(background), settings);
}

BlobTracker::~BlobTracker() = default;

void BlobTracker::reset() {
  state_->last.reset();
  state_->velocity_px.setZero();
}

std::optional<EllipseMeasurement> BlobTracker::update(const cv::Mat& image) {
  State& s = *state_;
  if (image.type() != CV_8UC1) throw std::invalid_argument("image: must be 8-bit gray");
  if (image.size() != s.background.mean().size()) {
    throw std::invalid_argument("image: its size differs from the background's");
  }
  std::optional<EllipseMeasurement> found;
  if (s.last) found = s.near_last(image);
  if (!found) found = s.anywhere(image);
  if (!found) {
    s.velocity_px.setZero();  // it may have turned; the place is still the best guess
    return found;
  }
  s.velocity_px = s.last ? Eigen::Vector2d(found->ellipse.center_px - s.last->center_px)
                         : Eigen::Vector2d(0, 0);
  s.last = found->ellipse;
  return found;
}

}  // namespace vitreo::vision
