// Batch tracing kernel: intersection and refraction of one lane; of the same kind as
// batch_kernel_body.h.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/rays/batch_kernel_profile.h"

namespace vitreo::optics::detail {
namespace {

/// A ray before a surface: from the vertex, and put near its vertex plane.
struct Lane {
  double dx;
  double dy;
  double dz;
  double ahead;  // m, along the ray, how far it was put
  // where to
  double px;
  double py;
  double pz;
};

/// 1 / dz is about 2 - dz, so without a division the ray comes as near to the vertex plane as
/// needed: seen from there, the two intersections with a conic lie well apart.
VITREO_INLINE Lane lane_of(const KernelSurface& f, const RayBlock& r, int i) {
  Lane lane;
  lane.dx = r.dx[i];
  lane.dy = r.dy[i];
  lane.dz = r.dz[i];
  const double z = r.z[i] - f.vertex;
  lane.ahead = -z * f.sense * (2.0 - lane.dz * f.sense);
  lane.px = r.x[i] + lane.ahead * lane.dx;
  lane.py = r.y[i] + lane.ahead * lane.dy;
  lane.pz = z + lane.ahead * lane.dz;
  return lane;
}

/// Where a ray meets a surface, and the normal there; all lengths from the vertex.
struct Intersection {
  double x;
  double y;
  double z;
  double s;  // m, from the ray's place before
  // a normal (any length, z > 0) and the direction's product with it
  double gx;
  double gy;
  double gz;
  double q;
};

/// All but q.
VITREO_INLINE void stand_on_conic(const KernelSurface& f, const Lane& l, double s,
                                  Intersection& m) {
  m.s = l.ahead + s;
  m.x = l.px + s * l.dx;
  m.y = l.py + s * l.dy;
  m.z = l.pz + s * l.dz;
  m.gx = -f.curvature * m.x;
  m.gy = -f.curvature * m.y;
  m.gz = 1.0 - (1 + f.conic) * f.curvature * m.z;
}

/// From p = (px, py, pz) the conic F = c (x^2 + y^2 + (1 + k) z^2) - 2 z = 0 is met where
/// A s^2 + 2 B s + E = 0, as in system/refraction.h, where pz = 0:
///  A = c (1 + k dz^2), B = c (px dx + py dy + (1 + k) pz dz) - dz,
///  E = c (px^2 + py^2 + (1 + k) pz^2) - 2 pz.
/// s = E / (q - B) with q = +-sqrt(B^2 - A E), which is the direction's product with the gradient
/// of -F / 2; its sign is that of dz.
/// Returns s, which counts from p.
VITREO_INLINE double meet_conic(const KernelSurface& f, const Lane& l, Intersection& m) {
  const double c = f.curvature;
  const double k1 = 1 + f.conic;
  const double a = c * (1.0 + f.conic * l.dz * l.dz);
  const double b = c * (l.px * l.dx + l.py * l.dy + k1 * (l.pz * l.dz)) - l.dz;
  const double e = c * (l.px * l.px + l.py * l.py + k1 * (l.pz * l.pz)) - 2.0 * l.pz;
  m.q = f.sense * __builtin_sqrt(b * b - a * e);
  const double s = e / (m.q - b);
  stand_on_conic(f, l, s, m);
  return s;
}

/// The ray behind a surface.
struct Refracted {
  double dx;
  double dy;
  double dz;
  double inside;  // negative or NaN at total reflection
  // where it crosses the stop's plane
  double stop_x;
  double stop_y;
};

/// With g the normal (any length), q = d . g and mu the ratio of indices,
///  d' = mu d + g (+-sqrt(g^2 (1 - mu^2) + mu^2 q^2) - mu q) / g^2,
/// which is Snell's law in vector form with the normal's length multiplied out: one root and one
/// division, and none where g^2 = 1. The hole of a stop lies in the vertex plane: before the
/// surface or behind it, by the sign of the sag.
template <bool kStop, bool kUnit>
VITREO_INLINE Refracted refract(const KernelSurface& f, double mu, const Lane& l,
                                const Intersection& m) {
  Refracted r;
  const double g2 = kUnit ? 1.0 : m.gx * m.gx + m.gy * m.gy + m.gz * m.gz;
  r.inside = g2 * (1.0 - mu * mu) + mu * mu * m.q * m.q;
  const double turned = f.sense * __builtin_sqrt(r.inside) - mu * m.q;
  const double bend = kUnit ? turned : turned / g2;
  r.dx = mu * l.dx + bend * m.gx;
  r.dy = mu * l.dy + bend * m.gy;
  r.dz = mu * l.dz + bend * m.gz;
  r.stop_x = 0.0;
  r.stop_y = 0.0;
  if constexpr (kStop) {
    const double behind = m.z * f.sense;
    const double ux = behind >= 0.0 ? l.dx : r.dx;
    const double uy = behind >= 0.0 ? l.dy : r.dy;
    const double back = m.z / (behind >= 0.0 ? l.dz : r.dz);
    r.stop_x = m.x - ux * back;
    r.stop_y = m.y - uy * back;
  }
  return r;
}

}  // namespace
}  // namespace vitreo::optics::detail
