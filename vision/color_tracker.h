// Tracks one object by its color and shape (thesis chapter 8), says how sure it is, and says so
// when it is not.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "vision/ellipse.h"
#include "vision/object_model.h"
#include "vision/object_view.h"

#include <opencv2/core/mat.hpp>

#include <memory>
#include <optional>
#include <string>

namespace vitreo::vision {

/// searching: not found yet. tracking: seen in this frame. coasting: not seen, still looked for
/// where it should be. lost: looked for in the whole image.
enum class TrackState { searching, tracking, coasting, lost };
std::string name_of(TrackState state);

struct ColorTrackerSettings {
  ObjectViewSettings view;
  double min_inliers = 0.35;      ///< share of the rim that must be seen while tracking
  double min_inliers_new = 0.55;  ///< and where it is first found, or found again
  double min_support = 0.35;      ///< share of the inside that must look like the object
  double max_against = 0.15;  ///< share of the inside that may be clearly the ground's, where most
                              ///< of the rim is seen
  double axis_change = 0.3;   ///< of an axis against its slow mean, relative
  double jump_px = 14;        ///< from where it was expected
  int coast_frames = 3;       ///< before the whole image is searched
  double coast_px = 2;        ///< by which gate and jump grow with each coasted frame
  int candidates = 3;         ///< places looked at in a searched image
  void check() const;         ///< throws std::invalid_argument naming the setting
};

/// What a tracker knows of its object's motion: enough to take a frame back.
struct TrackMemory {
  TrackState state = TrackState::searching;
  Ellipse last;                       ///< as measured, not calibrated
  Eigen::Vector2d velocity_px{0, 0};  ///< per frame
  double turn = 0;                    ///< rad per frame
  Eigen::Vector2d axes_px{0, 0};      ///< slow mean of the measured semi-axes
  int unseen = 0;                     ///< frames since it was last seen
};

struct Track {
  TrackState state = TrackState::searching;
  std::optional<EllipseMeasurement>
      measured;  ///< only while tracking; calibrated, covariance with the bias term
  std::optional<Ellipse> expected;  ///< where it was looked for; nothing while searching
  double support = 0;               ///< share of the inside that looks like the object
  double area_px = 0;               ///< of the level set's largest part
  int iterations = 0;
};

class ColorTracker {
 public:
  /// Throws std::invalid_argument naming the setting.
  ColorTracker(ObjectModel model, const ColorTrackerSettings& settings);
  ~ColorTracker();
  /// Throws std::invalid_argument when the image is not CV_8UC3 of the size trained. No allocation
  /// after the first image; the same images give the same tracks.
  Track update(const cv::Mat& image, const Owned& owned = {});
  void reset();  ///< forgets where it was
  /// Tells it where the object is, as a person points; it is tracked from there. Throws
  /// std::invalid_argument for an ellipse whose center is not in the image or whose axes are not
  /// positive.
  void place(const Ellipse& at);

  TrackState state() const;
  /// Where it should be in the next frame; nothing while searching.
  std::optional<Ellipse> expected() const;
  const ObjectModel& model() const;
  const TrackMemory& memory() const;
  /// Goes on from there as though what came later had not been.
  void restore(const TrackMemory& memory);
  /// The next frame does not show it, says somebody who knows more: coasting, then lost. The track
  /// says the same.
  Track miss();

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace vitreo::vision
