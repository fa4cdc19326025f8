// Third-order (Seidel) aberrations, surface by surface, for conics with a term of r^4.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/system/system.h"

#include <vector>

namespace vitreo::optics {

/// Seidel sums in m of optical path, as in W. T. Welford, Aberrations of Optical Systems (1986),
/// ch. 8: wavefront aberration at the rim of the pupil and the edge of the field, in the sense of
/// light: W = S_I/8 rho^4 + S_II/2 y rho^3 cos + S_III/2 y^2 rho^2 cos^2 + (S_III + S_IV)/4 y^2
/// rho^2 + S_V/2 y^3 rho cos.
struct SeidelSums {
  double spherical = 0;    // S_I
  double coma = 0;         // S_II
  double astigmatism = 0;  // S_III
  double petzval = 0;      // S_IV
  double distortion = 0;   // S_V
  SeidelSums& operator+=(const SeidelSums& other);
};

struct Aberrations {
  std::vector<SeidelSums> surfaces;  // of surfaces 2 to the last
  SeidelSums total;
  double image_distance = 0;  // m, the paraxial image from the last vertex
  double image_height = 0;    // m, paraxial, signed
  double marginal_slope = 0;  // n' u' of the marginal ray behind the last surface
  double index = 1;           // n' there
  // 1/m, of the image of a flat object when there is no astigmatism; + concave to +z
  double petzval_curvature = 0;

  // What the sums mean at the paraxial image, m. Positive: towards +z, or away from the axis on the
  // image's side.
  // where the marginal ray crosses the axis, from the paraxial image
  double longitudinal_spherical() const;
  double tangential_field() const;   // focus of meridional rays at the edge of the field
  double sagittal_field() const;     // and of sagittal ones
  double distortion_height() const;  // what the chief ray's height differs by
};

/// Of a flat object in the plane z = `depth` (m), its edge at height `object_height` (m), through
/// the full stop. Terms of r^6 and higher are of no third order. The retina's own curvature is no
/// aberration and not in it. Throws std::invalid_argument: no stop, a depth outside the vitreous,
/// an image at infinity.
Aberrations third_order_aberrations(const System& system, double object_height, double depth = 0);

}  // namespace vitreo::optics
