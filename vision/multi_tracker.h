// Several objects in one image, of different color or of the same, touching or not (thesis 8.3.1):
// each is masked from what the others own, and none takes another's place without saying so.
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

/// Every pixel belongs to whose expected ellipse is nearest; so two that touch share a border that
/// shape and prediction draw, whatever their colors. Where it matters a frame is measured twice,
/// the second time by the ellipses just measured. Objects whose colors are alike can be told apart
/// only by where they were: when two of them run into one another both are lost, and one that was
/// lost counts as found only where it can not be the other.
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
  /// Says where one is, as ColorTracker::place; throws std::out_of_range for an object there is
  /// not.
  void place(std::size_t object, const Ellipse& at);
  void reset();
  /// CV_8UC1: 0, or the number of the object, from 1, that has the pixel. Of the last image.
  const cv::Mat& owners() const;
  /// Whether two objects' colors are alike, so that only place tells them apart.
  bool alike(std::size_t one, std::size_t other) const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace vitreo::vision
