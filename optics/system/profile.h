// Profile of a rotationally symmetric surface: the sag (3.1) and its slope, for doubles and for
// Ceres' Jets.
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

}  // namespace vitreo::optics::detail
