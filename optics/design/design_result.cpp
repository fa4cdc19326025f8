// SPDX-License-Identifier: Apache-2.0
#include "optics/design/design_result.h"

#include "optics/system/first_order.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace vitreo::optics {
namespace {

/// Infinite for an afocal system.
double focal_length_of(const System& system) {
  const auto points = cardinal_points(system);
  return points ? points->focal_length : std::numeric_limits<double>::infinity();
}

}  // namespace

const char* to_string(DesignStatus status) {
  switch (status) {
    case DesignStatus::converged:
      return "converged";
    case DesignStatus::not_converged:
      return "not converged";
    case DesignStatus::rays_lost:
      return "rays lost";
    case DesignStatus::constraint_violated:
      return "constraint violated";
  }
  return "unknown";
}

/// Merit of the header, over the fields from which rays come through: flatness is the spread of
/// best foci about their mean, spots their rms radii.
/// A field with a cut bundle counts with the rays that come through, and in lost_fields. With the
/// plain tracer, so that the figures do not come from the code that was optimized.
LensImage lens_image(const System& system, const LensDesignOptions& options) {
  options.check();
  const PupilTracer tracer(system, Pupil::of_stop(system));
  LensImage image;
  image.fields = field_curves(tracer, options.angles, disc_samples(options.rings, options.arms),
                              options.depth);
  image.focal_length = focal_length_of(system);
  image.image_distance = image.fields.front().best_focus;
  image.span = field_curvature_span(image.fields);
  double mean = 0;
  double flatness = 0;
  double spots = 0;
  int count = 0;
  for (const FieldPoint& point : image.fields) {
    if (!(point.transmitted == 1)) ++image.lost_fields;
    if (!(point.transmitted > 0)) continue;
    mean += point.best_focus, spots += point.rms * point.rms, ++count;
    image.max_spot = std::max(image.max_spot, point.rms);
  }
  mean /= count;
  for (const FieldPoint& point : image.fields) {
    if (point.transmitted > 0) flatness += (point.best_focus - mean) * (point.best_focus - mean);
  }
  image.merit = std::sqrt((options.flatness_weight * options.flatness_weight * flatness +
                           options.spot_weight * options.spot_weight * spots) /
                          count);
  return image;
}

}  // namespace vitreo::optics
