// Color and shape tracker of one object (thesis chapter 8): an ellipse with covariance, or an
// explicit loss of track.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "vision/ellipse.h"
#include "vision/ground_ring.h"
#include "vision/ground_thumbnail.h"
#include "vision/light.h"
#include "vision/object_model.h"
#include "vision/object_view.h"

#include <opencv2/core/mat.hpp>

#include <memory>
#include <optional>
#include <string>

namespace vitreo::vision {

/// searching: not found yet. tracking: measured in this frame. coasting: not found, still searched
/// at the predicted position. lost: searched in the whole image.
enum class TrackState { searching, tracking, coasting, lost };
std::string name_of(TrackState state);

struct ColorTrackerSettings {
  ObjectViewSettings view;
  double min_inliers = 0.35;      ///< share of the rim that must be found while tracking
  double min_inliers_new = 0.55;  ///< and where it is first found, or found again
  double min_support = 0.35;      ///< share of the inside whose colors are the object's
  /// Share of the inside that may be clearly the ground's, where most of the rim is found.
  double max_against = 0.15;
  double axis_change = 0.3;  ///< of an axis against its slow mean, relative
  /// Of the object against the masks (zoom, height): least and most that is followed.
  double least_size = 0.42;
  double most_size = 2.4;
  /// Search it in other sizes too where none of the size known is found: a size a frame.
  bool any_size = true;
  double jump_px = 14;   ///< from the predicted center
  int coast_frames = 3;  ///< before the whole image is searched
  double coast_px = 2;   ///< by which gate and jump grow with each coasted frame
  int candidates = 3;    ///< candidates measured in a searched image
  /// Frames that must agree before an object found anew is believed; 1: at once.
  int confirm_frames = 3;
  /// Of LookWorth::likeness: of one followed, and of one found anew.
  double min_likeness = -1.0;
  double min_likeness_new = 0.0;
  /// By how much the likeness of one found anew exceeds that of the best other candidate, and of
  /// what the audit took for it; else, where the audit took anything, it must move.
  double sure_margin = 2.0;
  double moved_px = 5;  ///< against the ground, and four of its standard deviations
  /// Follow light and white balance by what ground and object show of them.
  bool adapt = true;
  void check() const;  ///< throws std::invalid_argument naming the setting
};

/// Motion state of a tracker: enough to undo a frame.
struct TrackMemory {
  TrackState state = TrackState::searching;
  Ellipse last;                            ///< as measured, not calibrated
  Eigen::Vector2d velocity_px{0, 0};       ///< per frame
  double turn = 0;                         ///< rad per frame
  Eigen::Vector2d axes_px{0, 0};           ///< slow mean of the measured semi-axes
  double growth = 0;                       ///< of both, natural logarithm per frame
  unsigned size_turn = 0;                  ///< counts the sizes that were searched
  unsigned searches = 0;                   ///< counts the images that were searched as a whole
  bool other_waits = true;                 ///< another way has work kept for it in the next one
  int unseen = 0;                          ///< frames since the last measurement
  Ellipse believed;                        ///< `last`, of the last frame that was tracked
  Eigen::Vector2d believed_axes_px{0, 0};  ///< and `axes_px`
  int agreed = 0;                          ///< frames of a new find that is not believed yet
  Eigen::Vector2d found_px{0, 0};          ///< where it was found
  GroundRing found_ground;                 ///< and the ground around it then
  GroundRing found_place;                  ///< and its own rim there
  double found_reach_px = 0;               ///< its long semi-axis then
  bool found_doubtful = false;             ///< the audit took anything of a size that it had since
  double margin = 0;                       ///< least of its frames, as Track::margin
  double heading = 0;       ///< rad: of the two along the major axis the one that is followed
  double heading_odds = 0;  ///< log odds of it against the opposite one
  /// LookWorth::center and shape of the last image that was measured.
  double last_center_worth = 1;
  double last_shape_worth = 1;
  LightMemory light;     ///< against that of the training
  GroundHistory ground;  ///< of the images in which it was tracked
};

struct Track {
  TrackState state = TrackState::searching;
  /// Only while tracking; calibrated, the covariance with the bias term.
  std::optional<EllipseMeasurement> measured;
  std::optional<Ellipse> expected;  ///< the prediction; nothing while searching
  double support = 0;               ///< share of the inside whose colors are the object's
  /// Among looks in training that were like this one, log of how much oftener they were at the
  /// object than at anything else; 0 where the model has no memory of looks.
  double likeness = 0;
  /// Of an object found anew, and of a candidate for it: by how much its likeness exceeds that of
  /// the second best, in this image or among what the audit took for the object.
  std::optional<double> margin;
  /// A find that has not been believed yet: too few frames agree, or it may be anatomy.
  std::optional<Ellipse> candidate;
  /// Whether the look measured itself: without the rim's refinement the covariance is a constant,
  /// and nothing tells a good look from a bad one.
  bool self_measured = false;
  /// Only while tracking, with a model that has learnt a head, once it is 99 % sure.
  std::optional<Heading> heading;
  std::optional<TipMeasurement> tip;  ///< with the heading
  double area_px = 0;                 ///< of the level set's largest part
  int iterations = 0;
  double work = 0;  ///< what the image cost, in looks at the trained size; bounds its time
  LogColor light = LogColor::Zero();  ///< gains of blue, green, red that the look reckoned with
};

class ColorTracker {
 public:
  /// Of Track::work. What is left to be done then waits for the next image.
  static constexpr double kMostWork = 5.5;
  /// Throws std::invalid_argument naming the setting.
  ColorTracker(ObjectModel model, const ColorTrackerSettings& settings);
  ~ColorTracker();
  /// Throws std::invalid_argument when the image is not CV_8UC3 of the size trained. No allocation
  /// after the first image; the same images give the same tracks.
  Track update(const cv::Mat& image, const Owned& owned = {});
  void reset();  ///< back to searching
  /// Sets the object's ellipse, as an operator points at it; it is tracked from there. Throws
  /// std::invalid_argument for an ellipse whose center is not in the image or whose axes are not
  /// positive.
  void place(const Ellipse& at);

  TrackState state() const;
  /// The prediction for the next frame; nothing while searching.
  std::optional<Ellipse> expected() const;
  const ObjectModel& model() const;
  const TrackMemory& memory() const;
  /// Resumes from an earlier memory() as if the frames since then had not been.
  void restore(const TrackMemory& memory);
  /// Counts the next frame as one without a measurement (the multi-tracker's verdict): coasting,
  /// then lost, which the track returned reports.
  Track miss();

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace vitreo::vision
