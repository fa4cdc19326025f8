// Retina map: where each frame of a moving view lies on the retina, at camera rate, by registration
// with the nearest of the frames that the map is made of; it grows where the view leaves them.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "vision/ellipse.h"

#include <Eigen/Geometry>
#include <opencv2/core/mat.hpp>

#include <memory>
#include <optional>
#include <span>

namespace vitreo::vision {

struct RetinaMapSettings {
  /// Structure larger than this is light, not retina; px.
  double flatten_px = 40;
  /// Pearson's correlation of frame and map over the points that carry structure.
  double min_correlation = 0.5;
  /// Share of a map's frame that must be in view for it to be registered with.
  double min_overlap = 0.35;
  /// Below this share of the nearest map's frame the present one becomes a part of the map.
  double grow_overlap = 0.7;
  int max_frames = 200;  ///< of the map
  void check() const;    ///< throws std::invalid_argument naming the setting
};

/// Where a frame lies. The map's frame is that of the first frame, px.
struct RetinaPose {
  Eigen::Affine2d map_from_image = Eigen::Affine2d::Identity();  ///< a similarity
  /// Standard deviation of a point's place in the map: of this registration, from its residuals,
  /// and of the chain of the map's frames up to the one that it was registered with.
  double sigma_px = 0;
  double correlation = 0;
  double overlap = 0;  ///< share of that frame in view
  int frame = 0;       ///< of the map, from 0
  bool grew = false;   ///< this frame is a part of the map now
  double scale() const;
  double angle() const;  ///< rad
};

class RetinaMap {
 public:
  explicit RetinaMap(const RetinaMapSettings& settings = {});
  ~RetinaMap();
  /// CV_8UC1, or CV_8UC3 of which green counts, of one size, at least 160 px a side. `bodies`: what
  /// is not retina, with its blur. Nothing where the frame cannot be found on the map: blurred,
  /// covered, or gone elsewhere; the next is searched afresh. The first frame makes the map; a
  /// blank one does not. Throws std::invalid_argument for another size or type.
  std::optional<RetinaPose> update(const cv::Mat& image, std::span<const Ellipse> bodies = {});
  int frames() const;
  void reset();

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace vitreo::vision
