// The single-viewpoint projection, (5.2) to (5.11), for doubles and for Ceres' Jets.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/numerics/scalar.h"
#include "optics/projection/single_viewpoint.h"

#include <Eigen/Core>

#include <cmath>
#include <optional>

namespace vitreo::optics::detail {

/// Slope of the isopixel curve at |m| = h, (5.2), and its derivative.
inline double slope_at(const SingleViewpoint& view, double h) {
  const auto& [a, b, c, d] = view.slope_from_m;
  return ((a * h + b) * h + c) * h + d;
}
inline double slope_derivative_at(const SingleViewpoint& view, double h) {
  const auto& [a, b, c, d] = view.slope_from_m;
  return (3 * a * h + 2 * b) * h + c;
}

/// The real root |m| of (5.2) within [0, max_m]; nothing when there is none.
std::optional<double> height_from_slope(const SingleViewpoint& view, double slope);

/// The aerial-image point of `from_viewpoint` = X - p_0, (5.3). False when the line of sight is
/// outside the fit. The thesis' tan(arccos) and 1/sqrt(1 + tan^2) lose the quadrant; lengths and
/// unit vectors keep it.
template <class T>
bool project(const SingleViewpoint& view, const Vector3<T>& from_viewpoint, Vector2<T>& m) {
  using std::sqrt;
  constexpr double kNearest = 1e-4;  // m; a point this close to the viewpoint has no line of sight
  constexpr double kOnAxis =
      1e-12;  // slope; there the azimuth is undefined and the cubic its tangent
  const T depth = -from_viewpoint.z();
  if (!(depth > kNearest)) return false;
  const Vector2<T> across = from_viewpoint.template head<2>() / depth;
  const T slope2 = across.squaredNorm();
  if (slope2 < kOnAxis * kOnAxis) {
    m = -across / slope_derivative_at(view, 0) + view.axis_m;
    return true;
  }
  const T slope = sqrt(slope2);  // (5.4)
  const std::optional<double> height = height_from_slope(view, scalar(slope));
  if (!height) return false;
  // One Newton step in T: changes nothing in the value and gives the derivative of the implicit
  // root.
  const T h = *height + (slope - slope_at(view, *height)) / slope_derivative_at(view, *height);
  m = across * (-h / slope) + view.axis_m;  // (5.10), (5.11): azimuth phi + pi
  return true;
}

}  // namespace vitreo::optics::detail
