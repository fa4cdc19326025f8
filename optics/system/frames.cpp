// SPDX-License-Identifier: Apache-2.0
#include "optics/system/frames.h"

#include "optics/numerics/preconditions.h"
#include "optics/system/refraction.h"

#include <limits>

namespace vitreo::optics {

/// The decenter counts in the eye frame, not in the turned one: a surface that is tilted further
/// stays where it is.
SurfaceFrame surface_frame(const System& system, int surface) {
  const double vertex = system.vertex(surface);
  const Placement& placed = system.surfaces[surface - 1].placement;
  return {placed.rotation(), placed.decenter + Eigen::Vector3d(0, 0, vertex)};
}

/// Pose after pose: R = Rm R0, and the vertex turns about the pivot.
void place_group(System& system, int first, int last, const Placement& motion,
                 const Eigen::Vector3d& pivot) {
  detail::require(first >= 2 && first <= last && last <= system.size(),
                  "first: the group must be surfaces of the system, and not the retina");
  detail::require(motion.decenter.allFinite() && motion.tilt.allFinite() && pivot.allFinite(),
                  "motion: must be finite");
  const Eigen::Matrix3d turn = motion.rotation();
  for (int number = first; number <= last; ++number) {
    const SurfaceFrame before = surface_frame(system, number);
    const Eigen::Vector3d origin = pivot + turn * (before.origin - pivot) + motion.decenter;
    system.surfaces[number - 1].placement = {origin - Eigen::Vector3d(0, 0, system.vertex(number)),
                                             tilt_of(turn * before.axes)};
  }
}

/// By the intersection that a trace uses, along the axis and from the vertex plane of the surface's
/// own frame.
double surface_height(const System& system, int number, const Eigen::Vector2d& at) {
  const Surface& surface = system.surfaces[number - 1];
  if (surface.placement.is_none() && !surface.is_toric())
    return system.vertex(number) + surface.sag(at.norm());
  const SurfaceFrame frame = surface_frame(system, number);
  const Eigen::Vector3d along = frame.axes.transpose() * Eigen::Vector3d::UnitZ();
  const Eigen::Vector3d from = frame.to_local({at.x(), at.y(), frame.origin.z()});
  const Eigen::Vector3d plane_point = from - along * (from.z() / along.z());
  double s = 0;
  const TraceStatus met = detail::is_asphere(surface) || surface.is_toric()
                              ? detail::meet_asphere(surface, plane_point, along, s)
                              : detail::meet_conic(surface, plane_point, along, s);
  if (met != TraceStatus::ok) return std::numeric_limits<double>::quiet_NaN();
  return frame.to_eye(plane_point + s * along).z();
}

}  // namespace vitreo::optics
