// Multi-object tracker (thesis 8.3.1): several objects in one image, of different color or of the
// same, touching or not; each is masked from the pixels of the others.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "vision/color_tracker.h"

#include <opencv2/core/mat.hpp>

#include <memory>
#include <vector>

namespace vitreo::vision {

struct TrackedObject {
  ObjectModel model;
  ColorTrackerSettings settings;
};

/// Every pixel belongs to the object whose predicted ellipse is nearest; so two that touch share a
/// border that shape and prediction draw, whatever their colors. Objects that touch are measured
/// twice, the second time with the ellipses just measured. Objects of similar colors and size are
/// distinguished only by their positions: when two of them merge both are lost, and one that was
/// lost counts as found only where it cannot be the other.
class MultiTracker {
 public:
  static constexpr int kMostObjects = 32;
  /// Throws std::invalid_argument for none or too many, for models of different image sizes, and as
  /// ColorTracker.
  MultiTracker(const std::vector<TrackedObject>& objects);
  ~MultiTracker();
  /// One track an object, in their order. Errors as ColorTracker::update. No allocation after the
  /// first image; the same images give the same tracks.
  const std::vector<Track>& update(const cv::Mat& image);
  /// As ColorTracker::place for one object; throws std::out_of_range for an index there is not.
  void place(std::size_t object, const Ellipse& at);
  void reset();
  /// CV_8UC1: 0, or the number of the object, from 1, that has the pixel. Of the last image.
  const cv::Mat& owners() const;
  /// Whether two objects' colors and sizes are alike, so that only position distinguishes them.
  bool alike(std::size_t one, std::size_t other) const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace vitreo::vision
