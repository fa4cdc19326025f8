// SPDX-License-Identifier: Apache-2.0
#include "optics/analysis/layout_rays.h"

#include "optics/numerics/preconditions.h"
#include "optics/rays/pupil.h"

#include <cmath>
#include <stdexcept>

namespace vitreo::optics {

/// The drawing's plane is x-z: a skew ray is shown in projection.
/// The path holds the origin, the point on each surface reached, and, for a ray that gets out, the
/// point in the plane `end_z` (m). A lost ray ends on the last surface that it reached.
LayoutRay ray_path(const System& system, const Ray& ray, double end_z, int group) {
  system.check();
  detail::require_finite(end_z, "end_z");
  LayoutRay drawn;
  drawn.group = group;
  const auto add = [&](const Eigen::Vector3d& p) { drawn.path.emplace_back(p.z(), p.x()); };
  add(ray.origin);
  Ray last = ray;
  // The trace keeps no path; a drawing has few rays, so each surface is reached from the start.
  for (int count = 2; count <= system.size(); ++count) {
    System head = system;
    head.surfaces.resize(static_cast<std::size_t>(count));
    if (head.stop && head.stop->surface > count) head.stop.reset();
    const TraceResult traced = trace_out(head, ray);
    if (traced.status != TraceStatus::ok) return drawn;
    last = traced.ray;
    add(last.origin);
  }
  if (last.direction.z() > 0 && end_z > last.origin.z()) {
    add(last.origin + (end_z - last.origin.z()) / last.direction.z() * last.direction);
  }
  return drawn;
}

/// Rays are aimed at the stop and then followed without it.
/// A group is an angle, whether rays of it get through or not, so that a color means the same angle
/// in each drawing.
std::vector<LayoutRay> field_fans(const System& system, std::span<const double> angles,
                                  double end_z, int count, double depth) {
  if (count < 1 || count > 1000) throw std::invalid_argument("count: must lie within 1 and 1000");
  const PupilTracer pupil(system, Pupil::of_stop(system));
  System open = system;  // rays at the very rim must not be lost to rounding
  open.stop.reset();
  std::vector<LayoutRay> rays;
  int group = 0;
  for (double angle : angles) {
    const auto point = point_at_field(system, angle, depth);
    for (int i = 0; point && i < count; ++i) {
      // A meridional fan across the stop, rim to rim.
      const double across = count == 1 ? 0 : 2.0 * i / (count - 1) - 1;
      const auto ray = pupil.aim(*point, {across, 0});
      if (ray) rays.push_back(ray_path(open, *ray, end_z, group));
    }
    ++group;
  }
  return rays;
}

}  // namespace vitreo::optics
