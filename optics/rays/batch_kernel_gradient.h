// Batch tracing kernel: paths through media with a gradient; of the same kind as
// batch_kernel_body.h.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/rays/batch_kernel_frames.h"

namespace vitreo::optics::detail {
namespace {

/// From the frame of the surface that is met, whose frame the block is in.
VITREO_INLINE Vector in_medium(const KernelGradient& g, double x, double y, double z) {
  const Vector at = rotated(g.axes, {x, y, z});
  return {at.x + g.origin[0], at.y + g.origin[1], at.z + g.origin[2]};
}

/// Gradient::value of system/gradient.h with the index at the vertex.
VITREO_INLINE double index_in(const KernelGradient& g, const Vector& p) {
  const double r2 = p.x * p.x + p.y * p.y;
  return g.index + p.z * (g.along[0] + p.z * (g.along[1] + p.z * (g.along[2] + p.z * g.along[3]))) +
         r2 * (g.across[0] + r2 * (g.across[1] + r2 * g.across[2]));
}

/// The index at a point of the surface's frame.
VITREO_INLINE double index_at(const KernelGradient& g, double x, double y, double z) {
  return index_in(g, in_medium(g, x, y, z));
}

/// The right side of the ray equation, n grad n, in the medium's frame.
VITREO_INLINE Vector bend_at(const KernelGradient& g, const Vector& p) {
  const double r2 = p.x * p.x + p.y * p.y;
  const double n = index_in(g, p);
  const double radial = 2 * n * (g.across[0] + r2 * (2 * g.across[1] + r2 * (3 * g.across[2])));
  return {
      radial * p.x, radial * p.y,
      n * (g.along[0] + p.z * (2 * g.along[1] + p.z * (3 * g.along[2] + p.z * (4 * g.along[3]))))};
}

VITREO_INLINE Vector moved(const Vector& p, double by, const Vector& along) {
  return {p.x + by * along.x, p.y + by * along.y, p.z + by * along.z};
}

/// Six times the mean of the method's four slopes.
VITREO_INLINE Vector mean(const Vector& a, const Vector& b, const Vector& c, const Vector& d) {
  return {a.x + 2 * b.x + 2 * c.x + d.x, a.y + 2 * b.y + 2 * c.y + d.y,
          a.z + 2 * b.z + 2 * c.z + d.z};
}

/// Runge and Kutta's classical step of dr/dt = T, dT/dt = n grad n, as in gradient_path.cpp.
VITREO_INLINE void graded_step(const KernelGradient& g, double h, Vector& r, Vector& t) {
  const Vector a = bend_at(g, r);
  const Vector tb = moved(t, h / 2, a);
  const Vector b = bend_at(g, moved(r, h / 2, t));
  const Vector tc = moved(t, h / 2, b);
  const Vector c = bend_at(g, moved(r, h / 2, tb));
  const Vector td = moved(t, h, c);
  const Vector d = bend_at(g, moved(r, h, tc));
  r = moved(r, h / 6, mean(t, tb, tc, td));
  t = moved(t, h / 6, mean(a, b, c, d));
}

/// Newton's step along the tangent of a ray to the surface, in t.
template <bool kToric>
VITREO_INLINE double step_to(const KernelSurface& f, const KernelGradient& g, const Vector& r,
                             const Vector& t) {
  const Vector at = rotated_back(g.axes, {r.x - g.origin[0], r.y - g.origin[1], r.z - g.origin[2]});
  const Vector along = rotated_back(g.axes, t);
  double sag;
  double slope_x;
  double slope_y;
  profile_at<kToric>(f, at.x, at.y, sag, slope_x, slope_y);
  return -(at.z - sag) / (along.z - (slope_x * (at.x * along.x) + slope_y * (at.y * along.y)));
}

/// follow_gradient of gradient_path.cpp for all lanes, in the surface's frame: the rays end on the
/// surface. Where there is none, or where it lies behind them, they are lost as missed; a lane ends
/// by its own test.
template <bool kToric>
void march(const KernelSurface& f, RayBlock& rays) {
  constexpr double kHere = 1e-16;  // m: below it a step is rounding
  const KernelGradient& g = f.before;
  const double missed = 8.0 * f.number + kLostMissed;
  const double no_convergence = 8.0 * f.number + kLostNoConvergence;
  VITREO_LANES
  for (int i = 0; i < kLanes; ++i) {
    Vector r = in_medium(g, rays.x[i], rays.y[i], rays.z[i]);
    const Vector d = rotated(g.axes, {rays.dx[i], rays.dy[i], rays.dz[i]});
    const double n = index_in(g, r);
    Vector t = {n * d.x, n * d.y, n * d.z};
    const double whole = -rays.z[i] / (n * rays.dz[i]);
    double travelled = whole;
    for (int k = 0; k < kGradientSteps; ++k) graded_step(g, whole / kGradientSteps, r, t);
    const double aside = step_to<kToric>(f, g, r, t);
    travelled += aside;
    constexpr int kHalf = kGradientSteps / 2;
    for (int k = 0; k < kHalf; ++k) graded_step(g, aside / kHalf, r, t);
    double last = 1.0;
    for (int k = 0; k < kGradientNewton; ++k) {
      const double h = step_to<kToric>(f, g, r, t);
      const double size = last < kHere ? 0.0 : 1.0;  // a lane that has arrived stays
      graded_step(g, h * size, r, t);
      travelled += h * size;
      last = size == 0.0 ? last : (h < 0.0 ? -h : h);
    }
    const Vector at =
        rotated_back(g.axes, {r.x - g.origin[0], r.y - g.origin[1], r.z - g.origin[2]});
    const Vector along = rotated_back(g.axes, t);
    const double unit =
        1.0 / __builtin_sqrt(along.x * along.x + along.y * along.y + along.z * along.z);
    double code = last < 1e3 * kHere ? 0.0 : no_convergence;
    code = !(travelled > kBackwards) ? missed : code;
    code = !(last < 1.0) ? missed : code;  // NaN: the surface does not reach there
    rays.lost[i] = rays.lost[i] == 0.0 ? code : rays.lost[i];
    rays.x[i] = at.x;
    rays.y[i] = at.y;
    rays.z[i] = at.z;
    rays.dx[i] = along.x * unit;
    rays.dy[i] = along.y * unit;
    rays.dz[i] = along.z * unit;
  }
}

}  // namespace
}  // namespace vitreo::optics::detail
