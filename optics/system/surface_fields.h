// Numbers of a surface that is no surface of revolution about the axis, by name.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/system/system.h"

#include <span>

namespace vitreo::optics {

/// A number of Surface::placement, of a toric surface, or of the gradient of the medium behind.
/// 0 where the surface has no such thing.
struct SurfaceField {
  const char* name;  // "tilt_x"
  const char* unit;
  bool of_medium;  // belongs to the medium behind the surface
  double& (*of)(Surface&);
  double value(const Surface& surface) const { return of(const_cast<Surface&>(surface)); }
};

std::span<const SurfaceField> surface_fields();

}  // namespace vitreo::optics
