// Light, depth and field of ways to view the retina: numerical aperture, depth of focus and of
// field (thesis 4.1), field of view (3.1).
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/system/system.h"

#include <string>
#include <vector>

namespace vitreo::optics {

/// For the retina's vertex as the object. The thesis' 0.159 is `oslo`; the others are
/// self-consistent.
struct NumericalAperture {
  // OSLO's rule: object_beam / |m|, the beam having the stop's radius in surface 2's vertex plane
  double oslo = 0;
  double object_beam = 0;  // n_v sin(atan(radius / distance)) of that beam, in the vitreous
  // n_i sin of its outermost ray behind the last surface, traced exactly; NaN-free: 0 if lost
  double image_beam = 0;
  // n_v sin of the paraxial ray through the edge of the stop where the stop is
  double object_stop = 0;
  double image_stop = 0;  // that by the sine condition, object_stop / |m|
};

/// Throws std::invalid_argument for an unsound system, one without a stop, and when the retina's
/// image is at infinity.
NumericalAperture numerical_aperture(const System& system);

/// (4.1), delta = (n / A_N) (1 + m) c, by which sides n and A_N are taken from. In m.
struct DepthOfFocus {
  // n of the vitreous with OSLO's A_N of the image side: mixed, 95 um in the thesis
  double thesis = 0;
  double image_side = 0;   // n_i with the image side's A_N: how far the sensor may be off
  double object_side = 0;  // n_v with the object side's A_N: how far the object may be off
};

/// With circle of confusion `confusion`, m. Throws as numerical_aperture, and naming `confusion`.
DepthOfFocus depth_of_focus(const System& system, double confusion);

/// Depth of focus turned into a depth in the eye, m. The image moves faster the nearer the object
/// is to the lens.
struct DepthOfField {
  // the thesis' depth of focus over the secant slope of the first `range` of figure 3.4(b)
  double thesis = 0;
  // the thesis' depth of focus over the slope at the retina, where it is worst
  double at_retina = 0;
  double consistent = 0;  // the image side's depth of focus over the slope at the retina
};
DepthOfField depth_of_field(const System& system, double confusion, double range = 5e-3);

/// One ray of a field: where it meets each surface, and the angle under which the retinal point is
/// seen from the center of the stop, as the thesis counts fields.
struct ChiefRay {
  // rad, at the stop's center, between the axis and the straight line to the retina
  double field_angle = 0;
  std::vector<double> heights;  // m, per surface from the retina on; as many as it meets
  bool complete = false;        // it left the last surface
  double exit_angle = 0;        // rad, from the axis behind the last surface; when complete
};

/// The ray through the center of the stop that has `angle` (rad, from the axis) in the medium
/// before the stop's surface, traced both ways. Throws std::invalid_argument without a stop and for
/// an angle outside (-pi/2, pi/2).
ChiefRay chief_ray_at_stop(const System& system, double angle);

/// Limits of each way of viewing; the defaults are our assumptions, the thesis gives none.
struct FieldAssumptions {
  double observer_distance = 15e-3;    // m, direct: observer's pupil before the cornea
  double contact_radius = 2.1e-3;      // m, vitrectomy: clear radius of the contact lens' flat face
  double condensing_radius = 10.5e-3;  // m, indirect: clear radius of the condensing lens
};

/// Full field, rad. `limit` names what sets it.
struct FieldOfView {
  double angle = 0;
  std::string limit;
};

/// Direct ophthalmoscopy: 2 atan(r / d), half illumination: r the radius of the entrance pupil, d
/// its distance from an observer's pupil `observer_distance` before the last surface (after Smith &
/// Atchison 1997). Throws std::invalid_argument for a system without stop or a distance that is not
/// positive.
FieldOfView direct_field_of_view(const System& system, double observer_distance);

/// Contact and condensing lenses: the largest field whose chief ray, traced, stays within
/// `clear_radius` (m) on all surfaces behind `from_surface` and is not lost; vignetting by the lens
/// sets it (thesis 3.1.3).
FieldOfView vignetted_field_of_view(const System& system, int from_surface, double clear_radius);

}  // namespace vitreo::optics
