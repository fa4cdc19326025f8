// Radial rim: the object's rim on the color evidence, to a fraction of a pixel.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "vision/ellipse.h"
#include "vision/ellipse_fit.h"
#include "vision/evidence.h"

#include <optional>
#include <vector>

namespace vitreo::vision {

struct RadialRimSettings {
  int normals = 64;
  double search_px = 8;  ///< along each normal, either way
  int rounds = 3;
  void check() const;  ///< throws std::invalid_argument naming the setting
};

/// On each normal the cut of maximum likelihood: the change point with the largest sum of F inside
/// less the sum outside, which a highlight at the rim or a vessel beside it moves less than the
/// nearest change of sign; then the ellipse through the cuts by robust least squares (fit_ellipse),
/// with a weak prior at the prediction.
class RadialRim {
 public:
  explicit RadialRim(const RadialRimSettings& settings);
  /// Nothing where too few normals agree. `contrast` of the result is the median step of F over the
  /// rim.
  std::optional<EllipseMeasurement> measure(const Evidence& evidence, const Ellipse& start,
                                            const EllipsePrior& prior);
  /// Of the last measure(): interquartile range of the softness of the rim's steps. A shadow at one
  /// side makes a rim uneven; blur of the whole image does not.
  double unevenness_px() const { return unevenness_px_; }

 private:
  void cut(const Evidence& evidence, Normal& normal, double depth_px) const;
  void weigh_by_softness();
  RadialRimSettings settings_;
  std::vector<Normal> normals_;
  std::vector<double> steps_;
  double unevenness_px_ = 0;
};

}  // namespace vitreo::vision
