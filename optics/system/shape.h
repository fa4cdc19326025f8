// Shape of a surface, whatever its kind: its profile, the height of a point over it, its normal
// there. Templated as system/refraction.h, which meets it. Frame: the vertex is the origin. Lengths
// in m.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/numerics/scalar.h"
#include "optics/system/profile.h"
#include "optics/system/system.h"

#include <Eigen/Core>

#include <algorithm>
#include <type_traits>

namespace vitreo::optics::detail {

inline double curvature_of(const Surface& surface) { return 1 / surface.radius; }

template <class AnySurface, class T>
Profile<T> profile(const AnySurface& surface, const T& r2) {
  return profile(curvature_of(surface), surface.conic, surface.aspheric, r2);
}

inline bool is_toric(const Surface& surface) { return surface.is_toric(); }
/// Surfaces that are being designed are surfaces of revolution.
template <class AnySurface>
bool is_toric(const AnySurface&) {
  return false;
}

template <class T>
ToricProfile<T> toric_profile(const Surface& surface, const T& x2, const T& y2) {
  return toric_profile({1 / surface.radius, 1 / surface.radius_y}, {surface.conic, surface.conic_y},
                       surface.aspheric, x2, y2);
}

inline bool is_asphere(const Surface& surface) {
  return std::any_of(surface.aspheric.begin(), surface.aspheric.end(),
                     [](double a) { return a != 0; });
}

/// The height of a point over the surface along z, and its gradient: the normal of the surface that
/// passes there (any length, z component 1).
template <class AnySurface, class T>
T height_over(const AnySurface& surface, const Vector3<T>& p, Vector3<T>& normal) {
  if constexpr (std::is_same_v<AnySurface, Surface>) {
    if (surface.is_toric()) {
      const ToricProfile<T> at = toric_profile(surface, T(p.x() * p.x()), T(p.y() * p.y()));
      normal = Vector3<T>(-at.slope_x_over_x * p.x(), -at.slope_y_over_y * p.y(), T(1));
      return p.z() - at.sag;
    }
  }
  const Profile<T> at = profile(surface, T(p.x() * p.x() + p.y() * p.y()));
  normal = Vector3<T>(-at.slope_over_r * p.x(), -at.slope_over_r * p.y(), T(1));
  return p.z() - at.sag;
}

}  // namespace vitreo::optics::detail
