// An optical system: the eye and what stands before it, as a list of surfaces.
// Frame: the *eye frame*: z along the optical axis in the direction of light (out of the eye),
// origin at the retina's vertex, x and y as in the world frame. The thesis calls this axis x. A
// radius is positive when its center lies at larger z.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/system/gradient.h"
#include "optics/system/medium.h"
#include "optics/system/placement.h"

#include <array>
#include <limits>
#include <optional>
#include <string>
#include <vector>

namespace vitreo::optics {

/// One surface and the medium behind it (towards +z). All lengths in m. Sag by thesis equation
/// (3.1): z = (r^2/R) / (1 + sqrt(1 - (1+c) r^2/R^2)) + a4 r^4 + a6 r^6 + a8 r^8 + a10 r^10.
struct Surface {
  double radius = std::numeric_limits<double>::infinity();  // m; infinite = plane
  double conic = 0;
  std::array<double, 4> aspheric{};  // a4, a6, a8, a10 in m^-3, m^-5, m^-7, m^-9
  double thickness = 0;  // m, along the axis to the next surface's vertex; unused on the last
  double index = 1;      // refractive index behind the surface
  // m; rays further out are clipped
  double semi_diameter = std::numeric_limits<double>::infinity();
  Placement placement;
  /// A toric (biconic) surface: radius and conic are those of the section along x, these those of
  /// the section along y, in the surface's own frame. 0: the same all round.
  double radius_y = 0;  // m
  double conic_y = 0;
  Gradient gradient;                         // of the index behind the surface
  Dispersion dispersion = Dispersion::none;  // of the medium behind it
  /// z - vertex at distance r from the axis, along x; NaN where the surface does not reach.
  double sag(double r) const;
  bool is_toric() const { return radius_y != 0; }
};

/// A flat circular hole in the vertex plane of a surface (counted as in the thesis: 1 is the
/// retina).
struct Stop {
  int surface = 0;
  double radius = 0;  // m
};

struct System {
  std::string name;
  std::vector<Surface> surfaces;  // the first is the retina
  std::optional<Stop> stop;
  double wavelength = kReferenceWavelength;  // m, in vacuum, of the light that `index` is for
  /// Whether all surfaces are surfaces of revolution about the axis.
  bool is_symmetric() const;
  bool is_graded() const;  // whether a medium between two surfaces has a gradient
  /// Throws std::invalid_argument naming the surface when one is off the axis or toric, or a medium
  /// has a gradient: for calculations that are of centered homogeneous systems only.
  void require_centered() const;
  /// z of a surface's vertex before it is decentered; `surface` counts from 1 as in the thesis'
  /// tables.
  double vertex(int surface) const;
  int size() const { return static_cast<int>(surfaces.size()); }
  /// Throws std::invalid_argument naming the surface and the parameter.
  void check() const;
};

/// The same system in other light: the index of each medium changes by as much as its model's.
/// Throws std::invalid_argument outside a model's range.
System at_wavelength(const System& system, double wavelength);

/// The two-lens model eye and condensing lens of thesis table 5.3, radius of surface 5 taken as
/// -9.48 mm (the printed sign is a misprint: it would make the eye a -30 D lens; docs/optics.md).
/// Stop: 3 mm diameter at surface 3.
System model_eye_5_3();

}  // namespace vitreo::optics
