// Exact ray tracing through a system.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/system/ray.h"
#include "optics/system/system.h"

#include <Eigen/Core>

namespace vitreo::optics {

struct TraceResult {
  Ray ray;  // behind the last surface met: origin on it
  TraceStatus status = TraceStatus::ok;
  int surface = 0;  // where the ray was lost, counted from 1; 0 when it was not
  double path = 0;  // m, optical path (index times length) from the ray's start to where it is now
};

/// Follows a ray that starts in the vitreous out of the eye: surfaces 2 to the last, refracting at
/// each. The stop clips, in the vertex plane of its surface and in whichever medium lies there. The
/// system is taken as checked. Throws std::invalid_argument naming `ray` when it is not finite or
/// its direction not unit. Sources: sag (3.1), Snell's law in vector form.
TraceResult trace_out(const System& system, const Ray& ray);

/// Follows a ray that comes from outside (direction towards -z) into the vitreous: the last surface
/// down to 2. Otherwise as trace_out, and its exact reverse.
/// Where a medium has a gradient the ray is followed through it by the method of Runge and Kutta
/// in 24 steps; in an eye's lens the error is below 1e-11 m.
TraceResult trace_in(const System& system, const Ray& ray);

}  // namespace vitreo::optics
