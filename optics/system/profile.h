// Profiles of surfaces of revolution and of toric surfaces: the sag (3.1) and its slope, for
// doubles and for Ceres' Jets.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cmath>
#include <limits>

namespace vitreo::optics::detail {

/// The profile at a distance from the axis; both NaN where the surface does not reach.
template <class T>
struct Profile {
  T sag;           // (3.1), m
  T slope_over_r;  // (d sag / d r) / r, 1/m: regular on the axis
};

/// At the squared distance `r2` from the axis: (3.1) with R = 1 / curvature and c = conic, and its
/// derivative by r over r. The conic part is curvature r^2 / (1 + sqrt(q)), q = 1 - (1 + c) r^2 /
/// R^2, which holds for a plane too; its derivative is curvature r / sqrt(q).
template <class S, class T>
Profile<T> profile(const S& curvature, const S& conic, const std::array<S, 4>& aspheric,
                   const T& r2) {
  using std::sqrt;
  const T q = 1.0 - (1.0 + conic) * curvature * curvature * r2;
  if (!(q >= 0.0)) {
    return {T(std::numeric_limits<double>::quiet_NaN()),
            T(std::numeric_limits<double>::quiet_NaN())};
  }
  const T root = sqrt(q);
  const auto& [a4, a6, a8, a10] = aspheric;
  // The polynomials in Horner's form.
  return {
      curvature * r2 / (1.0 + root) + r2 * r2 * (a4 + r2 * (a6 + r2 * (a8 + r2 * a10))),
      curvature / root + r2 * (4.0 * a4 + r2 * (6.0 * a6 + r2 * (8.0 * a8 + r2 * (10.0 * a10))))};
}

/// A toric (biconic) surface and its derivatives by x and y over x and y: (3.1) with c r^2 and
/// (1 + k) c^2 r^2 as sums over both sections.
template <class T>
struct ToricProfile {
  T sag;             // m
  T slope_x_over_x;  // 1/m
  T slope_y_over_y;
};

/// With e = cx x^2 + cy y^2 and q = 1 - (1 + kx) cx^2 x^2 - (1 + ky) cy^2 y^2 the conic part is
/// e / (1 + sqrt(q)); its derivative by x over x is
///  cx (2 / (1 + sqrt(q)) + e (1 + kx) cx / (sqrt(q) (1 + sqrt(q))^2)).
template <class T>
ToricProfile<T> toric_profile(const std::array<double, 2>& curvature,
                              const std::array<double, 2>& conic,
                              const std::array<double, 4>& aspheric, const T& x2, const T& y2) {
  using std::sqrt;
  const double bent_x = (1.0 + conic[0]) * curvature[0];
  const double bent_y = (1.0 + conic[1]) * curvature[1];
  const T q = 1.0 - bent_x * curvature[0] * x2 - bent_y * curvature[1] * y2;
  if (!(q >= 0.0)) {
    const T nothing(std::numeric_limits<double>::quiet_NaN());
    return {nothing, nothing, nothing};
  }
  const T root = sqrt(q);
  const T below = 1.0 + root;
  const T e = curvature[0] * x2 + curvature[1] * y2;
  const T bend = e / (root * below * below);
  const T r2 = x2 + y2;
  const auto& [a4, a6, a8, a10] = aspheric;
  const T round = r2 * (4.0 * a4 + r2 * (6.0 * a6 + r2 * (8.0 * a8 + r2 * (10.0 * a10))));
  return {e / below + r2 * r2 * (a4 + r2 * (a6 + r2 * (a8 + r2 * a10))),
          curvature[0] * (2.0 / below + bend * bent_x) + round,
          curvature[1] * (2.0 / below + bend * bent_y) + round};
}

}  // namespace vitreo::optics::detail
