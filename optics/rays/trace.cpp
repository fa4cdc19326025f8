// SPDX-License-Identifier: Apache-2.0
#include "optics/rays/trace.h"

#include "optics/numerics/preconditions.h"
#include "optics/system/refraction.h"

#include <cmath>
#include <stdexcept>

namespace vitreo::optics {
namespace {

/// Refuses what cannot be traced; the direction enters Snell's law as a unit vector.
void check_ray(const Ray& ray) {
  // of |direction|^2: catches what was never normalized, not what was rounded
  constexpr double kUnit = 1e-6;
  detail::require(ray.origin.allFinite(), "ray: its origin is not finite");
  detail::require(std::abs(ray.direction.squaredNorm() - 1) < kUnit,
                  "ray: its direction is not a unit vector");
}

/// Crosses surface `number` (vertex at z) outwards or inwards, in the frame of its vertex; on loss
/// sets the status in `result` and returns false.
/// `before` and `behind` are in the sense of travel: outwards the medium before a surface is the
/// previous row's, inwards its own.
bool step(const System& system, int number, double z, bool outwards, TraceResult& result) {
  const double before = system.surfaces[number - (outwards ? 2 : 1)].index;
  const double behind = system.surfaces[number - (outwards ? 1 : 2)].index;
  detail::Crossing<Surface> crossing{system.surfaces[number - 1], before / behind};
  if (system.stop && system.stop->surface == number) crossing.stop_radius = system.stop->radius;
  Eigen::Vector3d origin = result.ray.origin - Eigen::Vector3d(0, 0, z);
  result.status = detail::cross(crossing, origin, result.ray.direction);
  if (result.status != TraceStatus::ok) {
    result.surface = number;
    return false;
  }
  result.ray.origin = origin + Eigen::Vector3d(0, 0, z);
  return true;
}

/// A ray that goes the other way meets no surface.
/// Checks and turns back before the first surface, which the caller names as the one where it was
/// lost.
TraceResult start(const Ray& ray, bool outwards) {
  check_ray(ray);
  TraceResult result;
  result.ray = ray;
  if ((ray.direction.z() > 0) != outwards) result.status = TraceStatus::missed;
  return result;
}

}  // namespace

const char* to_string(TraceStatus status) {
  switch (status) {
    case TraceStatus::ok:
      return "ok";
    case TraceStatus::missed:
      return "missed";
    case TraceStatus::total_reflection:
      return "total reflection";
    case TraceStatus::clipped:
      return "clipped";
    case TraceStatus::wrong_sheet:
      return "wrong sheet";
    case TraceStatus::no_convergence:
      return "no convergence";
  }
  return "unknown";
}

/// Surfaces in the order of light; z is the vertex of the next one in the eye frame.
TraceResult trace_out(const System& system, const Ray& ray) {
  TraceResult result = start(ray, true);
  if (result.status != TraceStatus::ok) {
    result.surface = 2;
    return result;
  }
  double z = 0;
  for (int number = 2; number <= system.size(); ++number) {
    z += system.surfaces[number - 2].thickness;
    if (!step(system, number, z, true, result)) break;
  }
  return result;
}

/// Light is reversible: the same crossings backwards, each with its ratio of indices inverted.
TraceResult trace_in(const System& system, const Ray& ray) {
  TraceResult result = start(ray, false);
  if (result.status != TraceStatus::ok) {
    result.surface = system.size();
    return result;
  }
  // From the last vertex back; the surfaces' media change sides.
  double z = system.vertex(system.size());
  for (int number = system.size(); number >= 2; --number) {
    if (!step(system, number, z, false, result)) break;
    z -= system.surfaces[number - 2].thickness;
  }
  return result;
}

}  // namespace vitreo::optics
