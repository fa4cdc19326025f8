// Frames of a system's surfaces, and rigid motions of groups of them.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/system/system.h"

#include <Eigen/Core>

namespace vitreo::optics {

/// Of a surface counted from 1. Throws std::invalid_argument for a number that is none.
SurfaceFrame surface_frame(const System& system, int surface);

/// Moves the surfaces `first` to `last` (2 or more) as one rigid body: turned about `pivot` by
/// motion.rotation(), then moved by motion.decenter. What they were moved by before stays. Throws
/// std::invalid_argument for surfaces that are none, and for the retina, which the eye frame
/// belongs to.
void place_group(System& system, int first, int last, const Placement& motion,
                 const Eigen::Vector3d& pivot);

/// z (m, eye frame) where the line parallel to the axis at (x, y) meets a surface; NaN where the
/// surface does not reach.
double surface_height(const System& system, int surface, const Eigen::Vector2d& at);

}  // namespace vitreo::optics
