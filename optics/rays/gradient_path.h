// Path of a ray through a medium with a gradient of its index, up to the next surface.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/system/ray.h"
#include "optics/system/system.h"

#include <Eigen/Core>

namespace vitreo::optics::detail {

/// The index behind surface `number` at a point in the eye frame.
double index_at(const System& system, int number, const Eigen::Vector3d& point);

/// Moves the ray (eye frame, in the medium behind surface `medium`) to surface `target` and adds
/// the optical path to `path`. Numbers count from 1. On loss the ray is left alone.
TraceStatus follow_gradient(const System& system, int medium, int target, Ray& ray, double& path);

}  // namespace vitreo::optics::detail
