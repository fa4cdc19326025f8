// Surfaces whose shapes are variables with derivatives, in the form that system/refraction.h
// traces. Lengths in m.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/system/refraction.h"
#include "optics/system/system.h"

#include <array>
#include <vector>

namespace vitreo::optics::detail {

template <class T>
struct DesignSurface {
  T curvature;
  T conic;
  std::array<T, 4> aspheric;
  T thickness;
  double index;
  double semi_diameter;
  bool asphere;  // also one whose coefficients are zero now, if one of them is to change
};

template <class T>
const T& curvature_of(const DesignSurface<T>& surface) {
  return surface.curvature;
}
template <class T>
bool is_asphere(const DesignSurface<T>& surface) {
  return surface.asphere;
}

template <class T>
std::vector<DesignSurface<T>> design_surfaces(const System& system) {
  std::vector<DesignSurface<T>> made;
  for (const Surface& s : system.surfaces) {
    made.push_back({T(curvature_of(s)),
                    T(s.conic),
                    {T(s.aspheric[0]), T(s.aspheric[1]), T(s.aspheric[2]), T(s.aspheric[3])},
                    T(s.thickness),
                    s.index,
                    s.semi_diameter,
                    is_asphere(s)});
  }
  return made;
}

/// Takes a ray from the vertex frame of surface `from` (counted from 0) behind the last surface,
/// into that one's vertex frame; the stop clips nothing. False when the ray is lost.
template <class T>
bool trace_design(const std::vector<DesignSurface<T>>& surfaces, std::size_t from,
                  Vector3<T>& origin, Vector3<T>& direction) {
  for (std::size_t i = from + 1; i < surfaces.size(); ++i) {
    origin.z() -= surfaces[i - 1].thickness;
    const Crossing<DesignSurface<T>> crossing{surfaces[i],
                                              surfaces[i - 1].index / surfaces[i].index};
    if (cross(crossing, origin, direction) != TraceStatus::ok) return false;
  }
  return true;
}

}  // namespace vitreo::optics::detail
