// Field curves: best focus, its astigmatism, distortion and vignetting of the retina's image
// against the field angle.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/rays/pupil.h"

#include <vector>

namespace vitreo::optics {

/// One object point, `depth` before the retina at a field angle; distances from the last vertex, m.
struct FieldPoint {
  double angle = 0;         // rad, at the center of the stop
  double best_focus = 0;    // m; least rms radius of the samples
  double tangential = 0;    // m; least width along the plane of axis and object
  double sagittal = 0;      // m; least width across it
  double chief_height = 0;  // m, signed, of the chief ray at best_focus; negative: inverted
  double rms = 0;           // m, radius of the spot at best_focus
  // chief height in the plane of the on-axis best focus over magnification * object height - 1
  double distortion = 0;
  // share of the samples that come through; 0: the other values mean nothing
  double transmitted = 0;
};

/// Objects at the angles given (rad). The magnification for distortion is that of an object near
/// the axis at the same depth. Throws std::invalid_argument for a system without stop, and for a
/// depth without image on the axis.
std::vector<FieldPoint> field_curves(const PupilTracer& tracer, const std::vector<double>& angles,
                                     const std::vector<Eigen::Vector2d>& samples, double depth = 0);

/// Largest less smallest best focus: 0.21 mm over +-30 degrees for table 3.4.
double field_curvature_span(const std::vector<FieldPoint>& curve);

}  // namespace vitreo::optics
