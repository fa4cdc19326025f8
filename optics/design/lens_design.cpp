// SPDX-License-Identifier: Apache-2.0
#include "optics/design/lens_design.h"

#include "optics/design/designer.h"
#include "optics/system/first_order.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace vitreo::optics {
namespace {

double focal_length_of(const System& system) {
  const auto points = cardinal_points(system);
  return points ? points->focal_length : std::numeric_limits<double>::infinity();
}

/// Whether a design is to be preferred: whole bundles, then kept constraints, then merit; that it
/// settled counts last.
bool better(const LensDesign& one, const LensDesign& other) {
  if (one.after.lost_fields != other.after.lost_fields)
    return one.after.lost_fields < other.after.lost_fields;
  const bool keeps = one.status != DesignStatus::constraint_violated;
  if (keeps != (other.status != DesignStatus::constraint_violated)) return keeps;
  return one.after.merit < other.after.merit;
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

std::vector<double> LensDesignOptions::default_angles() {
  std::vector<double> angles;
  for (int degrees = 0; degrees <= 30; degrees += 5)
    angles.push_back(degrees * std::numbers::pi / 180);
  return angles;
}

void LensDesignOptions::check() const {
  const auto refuse_unless = [](bool good, const char* why) {
    if (!good) throw std::invalid_argument(why);
  };
  const auto length = [](double x) { return std::isfinite(x) && x >= 0; };
  refuse_unless(!variables.empty(), "variables: nothing to design");
  for (const DesignVariable& v : variables) {
    refuse_unless(v.lower <= v.upper,
                  ("variables: " + v.parameter + " has bounds that leave nothing").c_str());
  }
  refuse_unless(angles.size() >= 2 && angles.size() <= 1000,
                "angles: at least 2, at most 1000 fields");
  for (double angle : angles) {
    refuse_unless(angle >= 0 && angle < std::numbers::pi / 2,
                  "angles: must lie between 0 and 90 degrees");
  }
  refuse_unless(length(depth), "depth: must not be negative");
  refuse_unless(rings >= 2 && rings <= 100, "rings: must lie within 2 and 100");
  refuse_unless(arms >= 4 && arms <= 1000 && arms % 2 == 0,
                "arms: an even number within 4 and 1000");
  refuse_unless(length(flatness_weight), "flatness_weight: must not be negative");
  refuse_unless(length(spot_weight), "spot_weight: must not be negative");
  refuse_unless(flatness_weight > 0 || spot_weight > 0,
                "spot_weight: and flatness_weight are zero");
  refuse_unless(max_spot > 0, "max_spot: must be positive");
  refuse_unless(!aperture || (length(*aperture) && *aperture > 0), "aperture: must be positive");
  refuse_unless(length(min_edge_thickness), "min_edge_thickness: must not be negative");
  refuse_unless(length(min_center_thickness), "min_center_thickness: must not be negative");
  refuse_unless(max_iterations >= 1, "max_iterations: must be at least 1");
}

LensImage lens_image(const System& system, const LensDesignOptions& options) {
  options.check();
  const PupilTracer tracer(system, Pupil::of_stop(system));
  LensImage image;
  image.fields = field_curves(tracer, options.angles, disc_samples(options.rings, options.arms),
                              options.depth);
  image.focal_length = focal_length_of(system);
  image.image_distance = image.fields.front().best_focus;
  image.span = field_curvature_span(image.fields);
  double mean = 0, flatness = 0, spots = 0;
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

LensDesign design_lens(const Prescription& start, const LensDesignOptions& options) {
  LensDesign best = detail::Designer(start, options).run({false, false});
  for (const detail::Way& way :
       {detail::Way{true, false}, detail::Way{false, true}, detail::Way{true, true}}) {
    LensDesign other = detail::Designer(start, options).run(way);
    if (better(other, best)) best = std::move(other);
  }
  return best;
}

}  // namespace vitreo::optics
