// Ray of light, and the status of its trace.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

namespace vitreo::optics {

struct Ray {
  Eigen::Vector3d origin;     // m, eye frame
  Eigen::Vector3d direction;  // unit
};

/// Outcome of a trace; why a ray was lost. missed: no intersection ahead of it, or the surfaces
/// cross at its height; wrong_sheet: it would meet only the other sheet of the conic; clipped:
/// outside the stop or a surface's semi-diameter.
enum class TraceStatus { ok, missed, total_reflection, clipped, wrong_sheet, no_convergence };
const char* to_string(TraceStatus status);

}  // namespace vitreo::optics
