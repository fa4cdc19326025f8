// The background subtraction of the thesis' experiments (5.5) and its usual rivals, as plain as
// they are used: what differs from the empty scene, its largest part, that part's moments. No
// covariance: they have none to give.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "vision/ellipse.h"

#include <opencv2/core/mat.hpp>

#include <memory>
#include <optional>
#include <string>

namespace vitreo::vision {

enum class BackgroundKind {
  fixed,    ///< the mean of what was learnt, for good
  running,  ///< a mean that takes on `rate` of every frame where nothing stands out
  mog2,     ///< OpenCV's mixture of Gaussians a pixel (Zivkovic)
  knn,      ///< OpenCV's nearest neighbors a pixel (Zivkovic)
};
std::string name_of(BackgroundKind kind);
/// By name, as written above. Throws std::invalid_argument that lists the names.
BackgroundKind background_kind(const std::string& name);

struct BackgroundTrackerSettings {
  BackgroundKind kind = BackgroundKind::fixed;
  double threshold = 25;    ///< gray levels in the channel that differs most; fixed and running
  double rate = 0.02;       ///< per frame; running, mog2, knn
  double min_area_px = 60;  ///< of what can be the object
  double max_area_px = 0;   ///< 0: a tenth of the image
  void check() const;       ///< throws std::invalid_argument naming the setting
};

class BackgroundTracker {
 public:
  explicit BackgroundTracker(const BackgroundTrackerSettings& settings);
  ~BackgroundTracker();
  /// An 8-bit image, gray or color, without the object. Throws std::invalid_argument for another
  /// type, or one that is not as the first.
  void learn(const cv::Mat& image);
  /// The largest thing that differs, or nothing. Throws std::logic_error before anything was
  /// learnt, else as learn.
  std::optional<Ellipse> update(const cv::Mat& image);

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace vitreo::vision
