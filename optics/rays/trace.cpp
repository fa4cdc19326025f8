// SPDX-License-Identifier: Apache-2.0
#include "optics/rays/trace.h"

#include "optics/numerics/preconditions.h"
#include "optics/rays/gradient_path.h"
#include "optics/system/frames.h"
#include "optics/system/refraction.h"

#include <cmath>
#include <limits>
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

/// The stop of surface `number`; without one a hole that clips nothing.
double stop_radius_at(const System& system, int number) {
  return system.stop && system.stop->surface == number ? system.stop->radius
                                                       : std::numeric_limits<double>::infinity();
}

/// Crosses a surface of revolution about the axis between homogeneous media, whose vertex is at z.
TraceStatus cross_centered(const System& system, int number, double ratio, double z, Ray& ray) {
  const detail::Crossing<Surface> crossing{system.surfaces[number - 1], ratio,
                                           stop_radius_at(system, number)};
  Eigen::Vector3d origin = ray.origin - Eigen::Vector3d(0, 0, z);
  const TraceStatus status = detail::cross(crossing, origin, ray.direction);
  if (status == TraceStatus::ok) ray.origin = origin + Eigen::Vector3d(0, 0, z);
  return status;
}

/// Crosses any surface, in its own frame. `before` and `behind` are the rows of the media as the
/// ray goes.
TraceStatus cross_placed(const System& system, int number, int before, int behind, Ray& ray) {
  const SurfaceFrame frame = surface_frame(system, number);
  const auto ratio = [&](const Eigen::Vector3d& local) {
    const Eigen::Vector3d at = frame.to_eye(local);
    return detail::index_at(system, before, at) / detail::index_at(system, behind, at);
  };
  const detail::GradedCrossing<decltype(ratio)> crossing{system.surfaces[number - 1], ratio,
                                                         stop_radius_at(system, number)};
  Eigen::Vector3d origin = frame.to_local(ray.origin);
  Eigen::Vector3d direction = frame.axes.transpose() * ray.direction;
  const TraceStatus status = detail::cross(crossing, origin, direction);
  if (status == TraceStatus::ok)
    ray = {frame.to_eye(origin), (frame.axes * direction).normalized()};
  return status;
}

/// Crosses surface `number` (vertex at z before it is decentered) outwards or inwards; on loss sets
/// the status in `result` and returns false.
/// The media are in the sense of travel: outwards the medium before a surface is the previous
/// row's, inwards its own.
bool step(const System& system, int number, double z, bool outwards, TraceResult& result) {
  const int before = number - (outwards ? 1 : 0);
  const int behind = number - (outwards ? 0 : 1);
  const Surface& media_before = system.surfaces[before - 1];
  const Surface& media_behind = system.surfaces[behind - 1];
  const bool graded = !media_before.gradient.is_none();
  Ray ray = result.ray;
  double path = 0;
  // A gradient's way ends on the surface; a straight one is found by the crossing itself.
  if (graded) result.status = detail::follow_gradient(system, before, number, ray, path);
  const Eigen::Vector3d from = ray.origin;
  if (result.status == TraceStatus::ok) {
    const bool centered =
        system.surfaces[number - 1].placement.is_none() && media_behind.gradient.is_none();
    result.status =
        centered && !graded
            ? cross_centered(system, number, media_before.index / media_behind.index, z, ray)
            : cross_placed(system, number, before, behind, ray);
  }
  if (result.status != TraceStatus::ok) {
    result.surface = number;
    return false;
  }
  if (!graded) path = media_before.index * (ray.origin - from).norm();
  result.ray = ray;
  result.path += path;
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
