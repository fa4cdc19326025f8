// First-order optics: the matrices of thesis (4.2) to (4.9), cardinal points, images of objects on
// the axis.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/system/system.h"

#include <Eigen/Core>

#include <optional>

namespace vitreo::optics {

/// Matrices act on (n * angle, height), the height in m. Refraction (4.2), (4.3) and transfer
/// (4.4).
Eigen::Matrix2d refraction_matrix(double index_before, double index_behind, double radius);
Eigen::Matrix2d transfer_matrix(double thickness, double index);

/// Transfer through the medium behind a surface, its gradient included: the paraxial ray equation
/// d(n u)/dz = 2 r2(z) y, dy/dz = (n u) / n(z) by the method of Runge and Kutta.
Eigen::Matrix2d medium_matrix(const Surface& surface);

/// (4.5), (4.9): from before surface `from` to behind surface `to` (counted from 1, 2 <= from <=
/// to); by default from the vitreous at surface 2 to behind the last. Throws std::invalid_argument
/// naming the argument. Surfaces off the axis count as if they were on it, toric ones by their mean
/// curvature (the spherical equivalent).
Eigen::Matrix2d system_matrix(const System& system, int from = 2, int to = 0);

/// Signed distances along +z, in m. O1 is the vertex of surface 2, O2 that of the last surface.
struct CardinalPoints {
  double focal_length = 0;            // f, (4.6): of the whole, as seen in a medium of index 1
  double front_focal_length = 0;      // n_v f, in the vitreous
  double back_focal_length = 0;       // n_i f, behind the last surface
  double first_principal_point = 0;   // [O1, PP1], (4.7)
  double second_principal_point = 0;  // [O2, PP2], (4.8)
  double front_focus = 0;             // [O1, F1]
  double back_focus = 0;              // [O2, F2]
  double first_nodal_point = 0;       // [O1, N1]
  double second_nodal_point = 0;      // [O2, N2]
};

/// Nothing for an afocal system, which has none of them. Throws std::invalid_argument for an
/// unsound system.
std::optional<CardinalPoints> cardinal_points(const System& system);

struct AxialImage {
  double distance = 0;       // m, from the last vertex; negative: virtual, before it
  double magnification = 0;  // lateral
  // d distance / d depth, positive: images move out as objects leave the retina
  double longitudinal = 0;
};

/// The paraxial image of a point on the axis, `depth` m in front of the retina's vertex
/// (figures 3.2b, 3.3b, 3.4b). Nothing when it lies at infinity. Throws std::invalid_argument for a
/// depth outside the vitreous.
std::optional<AxialImage> axial_image(const System& system, double depth);

/// Slope of the secant of distance over depth from the retina to `depth`, as thesis 4.1 reads it
/// off figure 3.4(b). Nothing when either image lies at infinity or infinity lies between them.
std::optional<double> secant_slope(const System& system, double depth);

}  // namespace vitreo::optics
