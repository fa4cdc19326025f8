// Background-subtraction trackers: that of the thesis' experiments (section 5.5) and its usual
// rivals, as plainly as they are used: difference from the empty scene, largest component, its
// moments. They estimate no covariance.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "vision/ellipse.h"

#include <opencv2/core/mat.hpp>

#include <memory>
#include <optional>
#include <string>

namespace vitreo::vision {

enum class BackgroundKind {
  fixed,    ///< the mean of the images learnt, never changed
  running,  ///< exponential mean: takes on `rate` of every frame where there is no foreground
  mog2,     ///< OpenCV's mixture of Gaussians per pixel (Zivkovic 2004)
  knn,      ///< OpenCV's nearest neighbors per pixel (Zivkovic & van der Heijden 2006)
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
  /// type, or a size or type other than the first's.
  void learn(const cv::Mat& image);
  /// The largest component that differs, or nothing. Throws std::logic_error before anything was
  /// learnt, else as learn.
  std::optional<Ellipse> update(const cv::Mat& image);

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace vitreo::vision
