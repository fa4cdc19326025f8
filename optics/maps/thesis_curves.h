// The thesis' own description of wide-angle images (3.2.1): isofocus surfaces as conics and
// isopixel curves as lines, whose parameters are cubic polynomials of d_ls and d_op. Meridional
// plane: z along the axis, r across. Lengths in m.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/maps/wide_angle_map.h"

#include <array>
#include <optional>
#include <vector>

namespace vitreo::optics {

/// c0 + c1 x + c2 x^2 + c3 x^3 between two ends, and how well it fits.
struct Cubic {
  std::array<double, 4> c{};
  // of x: the fit holds between
  double from = 0;
  double to = 0;
  double max_residual = 0;
  double operator()(double x) const { return c[0] + x * (c[1] + x * (c[2] + x * c[3])); }
  bool covers(double x) const { return x >= from && x <= to; }
};

struct IsofocusSurface {
  double focus = 0;         // m, d_ls
  double radius = 0;        // m, of curvature where it meets the axis
  double pole = 0;          // m, z where it meets the axis
  double max_residual = 0;  // m, of distances from the conic
};

struct IsopixelCurve {
  double height = 0;        // m, |d_op|
  double slope = 0;         // dr/dz
  double intercept = 0;     // m, r at z = 0, the retina's vertex
  double max_residual = 0;  // m, of the line, across the axis
};

struct ThesisSettings {
  double conic = 0;  // of all isofocus surfaces: the retina's
  // from the retina's image on the axis to that of the deepest point; at least 5
  int surfaces = 11;
  int curves = 15;     // from near the axis to the edge; at least 5
  int samples = 15;    // points on each; at least 5
  void check() const;  // throws std::invalid_argument naming the parameter
};

struct ThesisCurves {
  double conic = 0;
  // of d_ls (figure 3.6a)
  Cubic radius;
  Cubic pole;
  // of |d_op| (figure 3.6b)
  Cubic slope;
  Cubic intercept;
  std::vector<IsofocusSurface> surfaces;
  std::vector<IsopixelCurve> curves;
  /// Where line and surface cross: (r, z). Nothing outside the cubics' ends or when they do not
  /// cross.
  std::optional<WideAngleMap::Plane> point(double focus, double height) const;
  /// The same with the cubics carried on beyond their ends, which is what an eye that is not the
  /// believed one makes of them (figure 4.2), the pole moved by `pole_shift`. For analyses of
  /// errors only.
  std::optional<WideAngleMap::Plane> extrapolated_point(double focus, double height,
                                                        double pole_shift = 0) const;
};

/// Draws the curves from the map and fits them. A surface or curve with fewer than five points in
/// the map is left out. Throws std::invalid_argument when too few are left for a cubic.
ThesisCurves fit_thesis_curves(const WideAngleMap& map, const ThesisSettings& settings = {});

}  // namespace vitreo::optics
