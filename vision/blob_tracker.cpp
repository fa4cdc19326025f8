// SPDX-License-Identifier: Apache-2.0
#include "vision/blob_tracker.h"

#include "vision/blob_search.h"
#include "vision/contour.h"
#include "vision/preconditions.h"

#include <cmath>
#include <utility>

namespace vitreo::vision {
namespace {

// px between the pixels read, near the last position and in the whole image.
constexpr int kNearStep = 2;
constexpr int kFarStep = 4;
// Of the searched region, when the robot is not in it or is cut by its border.
constexpr double kGrowth = 1.6;
// Relative change of an axis that can happen from one image to the next.
constexpr double kAxisChange = 0.06;
// Share of the rim that must be found for a robot partly hidden to be taken for the same one.
constexpr double kVisibleRim = 0.5;

bool same_axes(const Ellipse& a, const Ellipse& b) {
  return std::abs(a.semi_major_px / b.semi_major_px - 1) < kAxisChange &&
         std::abs(a.semi_minor_px / b.semi_minor_px - 1) < kAxisChange;
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

// Memory of one robot between images; the measurement itself has no state.
struct BlobTracker::State {
  State(Background learnt, const BlobTrackerSettings& chosen)
      : background(std::move(learnt)),
        settings(chosen),
        search(background, {settings.min_semi_minor_px, settings.max_semi_major_px,
                            settings.threshold_sigma, settings.min_contrast}),
        contour({settings.normals, settings.search_px, settings.blur_sigma_px,
                 settings.min_contrast, settings.corners}) {}

  std::optional<EllipseMeasurement> measure(const cv::Mat& image, const Ellipse& start);
  std::optional<EllipseMeasurement> near_last(const cv::Mat& image);
  std::optional<EllipseMeasurement> as_predicted(const cv::Mat& image);
  std::optional<EllipseMeasurement> of_blob(const cv::Mat& image, const Ellipse& blob);
  std::optional<EllipseMeasurement> anywhere(const cv::Mat& image);

  Background background;
  BlobTrackerSettings settings;
  BlobSearch search;
  Contour contour;
  std::optional<Ellipse> last;
  Eigen::Vector2d velocity_px{0, 0};  // per image
};

// The contour around `start`, if it is a robot by contrast, position and size.
// Nothing for a shadow (too little contrast), a body out of the frame or one of a size that the
// robot cannot have.
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

// The contour from the last ellipse moved by constant velocity; accepted only if it is the same
// robot.
// Constant velocity over one image. The axes must agree, so that debris of another size is not
// taken for the robot.
std::optional<EllipseMeasurement> BlobTracker::State::as_predicted(const cv::Mat& image) {
  Ellipse predicted = *last;
  predicted.center_px += velocity_px;
  auto found = measure(image, predicted);
  if (!found || found->inlier_fraction < kVisibleRim || !same_axes(found->ellipse, *last))
    return std::nullopt;
  return found;
}

// Debris that drifts up to the robot makes one blob with it, whose ellipse is neither's: from there
// the fit ends beside the rim. From the predicted ellipse the robot's own rim is found, and normals
// where it is hidden become outliers.
// The second attempt is used only where it finds the same robot; else what the blob gave is better
// than nothing.
std::optional<EllipseMeasurement> BlobTracker::State::of_blob(const cv::Mat& image,
                                                              const Ellipse& blob) {
  auto found = measure(image, blob);
  if (found && same_axes(found->ellipse, *last)) return found;
  const auto predicted = as_predicted(image);
  return predicted ? predicted : found;
}

// Blob search in a square around the prediction (constant velocity), which grows until it holds all
// of the blob it found, four times at most.
// Nothing in the squares is no loss yet: the rim is tried at the prediction before the whole image
// is searched.
std::optional<EllipseMeasurement> BlobTracker::State::near_last(const cv::Mat& image) {
  const Eigen::Vector2d center = last->center_px + velocity_px;
  const cv::Rect frame(0, 0, image.cols, image.rows);
  // Room for the robot at any angle, for the contour's normals on both sides and for one step.
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
  return as_predicted(image);
}

// Re-detection in the whole image, at a quarter of its rows and columns.
// A quarter of the rows and columns finds bodies of some cells' width; the contour then gives the
// fraction of a pixel.
std::optional<EllipseMeasurement> BlobTracker::State::anywhere(const cv::Mat& image) {
  const auto blob = search.largest(image, cv::Rect(0, 0, image.cols, image.rows), kFarStep);
  return blob ? measure(image, blob->ellipse) : std::nullopt;
}

BlobTracker::BlobTracker(Background background, const BlobTrackerSettings& settings) {
  settings.check();
  require(background.count() > 0, "background: has learnt no image");
  state_ = std::make_unique<State>(std::move(background), settings);
}

BlobTracker::~BlobTracker() = default;

// The next image is searched as a whole.
void BlobTracker::reset() {
  state_->last.reset();
  state_->velocity_px.setZero();
}

// Throws std::invalid_argument for another size or type. Nothing means not seen: the last position
// stays, as the robot is most likely still near it, but its velocity is forgotten.
std::optional<EllipseMeasurement> BlobTracker::update(const cv::Mat& image) {
  State& s = *state_;
  require(image.type() == CV_8UC1, "image: must be 8-bit gray");
  require(image.size() == s.background.mean().size(),
          "image: its size differs from the background's");
  std::optional<EllipseMeasurement> found;
  if (s.last) found = s.near_last(image);
  if (!found) found = s.anywhere(image);
  if (!found) {
    s.velocity_px.setZero();  // it may have turned; its last position is still the best guess
    return found;
  }
  s.velocity_px = s.last ? Eigen::Vector2d(found->ellipse.center_px - s.last->center_px)
                         : Eigen::Vector2d(0, 0);
  s.last = found->ellipse;
  return found;
}

}  // namespace vitreo::vision
