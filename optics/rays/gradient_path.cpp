// SPDX-License-Identifier: Apache-2.0
#include "optics/rays/gradient_path.h"

#include "optics/rays/batch_kernel.h"
#include "optics/system/frames.h"
#include "optics/system/refraction.h"

#include <cmath>

namespace vitreo::optics::detail {
namespace {

/// The ray equation d/ds (n dr/ds) = grad n with t = int ds / n (Sharma, Kumar & Ghatak 1982):
///  dr/dt = T,  dT/dt = n grad n,  dL/dt = n^2,  T = n dr/ds, L the optical path.
/// In the frame of the surface that the medium begins with.
struct GradedRay {
  Eigen::Vector3d r;  // m
  Eigen::Vector3d t;  // T
  double path = 0;    // m
};

/// The medium behind a surface; lengths from that surface's vertex.
class GradedMedium {
 public:
  explicit GradedMedium(const Surface& surface) : surface_(surface) {}
  double index(const Eigen::Vector3d& p) const {
    return surface_.index + surface_.gradient.value(p);
  }

  /// One step of the classical method of Runge and Kutta.
  GradedRay step(const GradedRay& from, double h) const {
    const Rate a = rate(from.r, from.t);
    const Rate b = rate(from.r + h / 2 * a.r, from.t + h / 2 * a.t);
    const Rate c = rate(from.r + h / 2 * b.r, from.t + h / 2 * b.t);
    const Rate d = rate(from.r + h * c.r, from.t + h * c.t);
    return {from.r + h / 6 * (a.r + 2 * b.r + 2 * c.r + d.r),
            from.t + h / 6 * (a.t + 2 * b.t + 2 * c.t + d.t),
            from.path + h / 6 * (a.path + 2 * b.path + 2 * c.path + d.path)};
  }

  GradedRay steps(GradedRay ray, double whole, int count) const {
    for (int i = 0; i < count; ++i) ray = step(ray, whole / count);
    return ray;
  }

 private:
  struct Rate {
    Eigen::Vector3d r;
    Eigen::Vector3d t;
    double path;
  };
  // The right sides of the three equations.
  Rate rate(const Eigen::Vector3d& r, const Eigen::Vector3d& t) const {
    const double n = index(r);
    return {t, n * surface_.gradient.derivative(r), n * n};
  }
  const Surface& surface_;
};

/// The target surface as seen from the medium's frame: height over it and its rate along the ray.
class Target {
 public:
  Target(const System& system, int number, const SurfaceFrame& medium)
      : surface_(system.surfaces[number - 1]), frame_(surface_frame(system, number)) {
    axes_ = frame_.axes.transpose() * medium.axes;
    origin_ = frame_.to_local(medium.origin);
  }
  double height(const GradedRay& ray, double& rate) const {
    const Eigen::Vector3d at = axes_ * ray.r + origin_;
    Eigen::Vector3d normal;
    const double over = height_over(surface_, at, normal);
    rate = normal.dot(axes_ * ray.t);
    return over;
  }
  /// t at which the straight line would cross the surface's vertex plane.
  double to_plane(const GradedRay& ray) const {
    return -(axes_ * ray.r + origin_).z() / (axes_ * ray.t).z();
  }

 private:
  const Surface& surface_;
  SurfaceFrame frame_;
  Eigen::Matrix3d axes_;  // target_from_medium
  Eigen::Vector3d origin_;
};

}  // namespace

/// A medium without a gradient needs no frame.
double index_at(const System& system, int number, const Eigen::Vector3d& point) {
  const Surface& surface = system.surfaces[number - 1];
  if (surface.gradient.is_none()) return surface.index;
  return surface.index + surface.gradient.value(surface_frame(system, number).to_local(point));
}

/// Equal steps to the surface's vertex plane as a straight line would meet it, equal steps from
/// there along the tangent to the surface, then Newton's method whose step is one of the
/// integrator, forwards or backwards: no interpolation is needed, and the same few operations serve
/// the vector kernel.
TraceStatus follow_gradient(const System& system, int medium, int target, Ray& ray, double& path) {
  constexpr double kHere = 1e-16;  // m: below it a step is rounding
  constexpr double kBackwards = -1e-12;
  // The gradient goes with its surface, wherever that has been moved to.
  const SurfaceFrame frame = surface_frame(system, medium);
  const GradedMedium graded(system.surfaces[medium - 1]);
  const Target surface(system, target, frame);
  GradedRay now{frame.to_local(ray.origin), frame.axes.transpose() * ray.direction, 0};
  now.t *= graded.index(now.r);
  const double whole = surface.to_plane(now);
  now = graded.steps(now, whole, kGradientSteps);
  double rate = 0;
  const double aside = -surface.height(now, rate) / rate;
  if (!std::isfinite(aside)) return TraceStatus::missed;
  now = graded.steps(now, aside, kGradientSteps / 2);
  for (int i = 0; i < kGradientNewton; ++i) {
    const double h = -surface.height(now, rate) / rate;
    if (!std::isfinite(h)) return TraceStatus::missed;
    now = graded.step(now, h);
    if (std::abs(h) < kHere) break;
    if (i + 1 == kGradientNewton && std::abs(h) > 1e3 * kHere) return TraceStatus::no_convergence;
  }
  if (!(now.path > kBackwards)) return TraceStatus::missed;
  ray.origin = frame.to_eye(now.r);
  ray.direction = (frame.axes * now.t).normalized();
  path += now.path;
  return TraceStatus::ok;
}

}  // namespace vitreo::optics::detail
