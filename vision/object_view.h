// Observation of one object in one frame: evidence within a gate, level set, shape prior, rim.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "vision/evidence.h"
#include "vision/level_set.h"
#include "vision/object_model.h"
#include "vision/radial_rim.h"

#include <memory>
#include <optional>
#include <vector>

namespace vitreo::vision {

/// Pixels that belong to other trackers' objects: CV_8UC1 of the image's size, not 0 and not `self`
/// = not to be entered.
struct Owned {
  cv::Mat map;
  unsigned char self = 0;
};

struct Observation {
  std::optional<EllipseMeasurement> measured;  ///< not yet calibrated
  Eigen::Vector2d expected_axes_px{0, 0};      ///< semi-axes
  Segment segment;
  std::optional<ShapeFit> shape;
  double support = 0;  ///< share of the measured ellipse's pixels with F > 0 that are not blocked
  /// Share of them that are clearly the ground's, beyond what it is of the object itself.
  double against = 0;
  double evidence = 0;       ///< mean F of them, each within +-4
  double unevenness_px = 0;  ///< RadialRim::unevenness_px
  bool leaked = false;
  int iterations = 0;
};

/// What the look memory compares. Only of a look with a refined rim.
/// `size`: against the masks.
LookFeatures features_of(const Observation& seen, double size);

/// Of the model's colors, of its network where it has one, or of gray levels where it has no color.
/// `model` must outlive it.
std::unique_ptr<EvidenceSource> evidence_source(const ObjectModel& model);

class ObjectView {
 public:
  /// `model` must outlive it.
  ObjectView(const ObjectModel& model, const ObjectViewSettings& settings);
  /// Starts at `expected` and stays within `gate_px` of its rim; `prior` regularizes the refined
  /// ellipse. The rim is searched around the level set's front, or, without `from_front`, around
  /// `expected`.
  Observation observe(const cv::Mat& image, const Ellipse& expected, double gate_px,
                      const EllipsePrior& prior, const Owned& owned = {}, bool from_front = true);
  /// Gains of the images to come against those of the training; none at first.
  void set_light(const LogColor& gains) { source_->set_light(gains); }

 private:
  const Evidence& read(const cv::Mat& image, const Ellipse& expected, double gate_px,
                       const Owned& owned);
  void to_prior(Observation& result);
  void count_support(const Ellipse& ellipse, Observation& observation) const;
  const ObjectModel* model_;
  ObjectViewSettings settings_;
  Thresholds thresholds_;
  int max_side_px_;
  std::unique_ptr<EvidenceSource> source_;
  Evidence evidence_;
  Evidence rim_evidence_;  // where the source has another one for the rim
  LevelSet level_set_;
  RadialRim rim_;
  std::vector<FrontPoint> front_;
};

}  // namespace vitreo::vision
