// Batch tracing kernel: the arithmetic of system/refraction.h over 64 rays, written so that the
// compiler makes vectors of it. Included once by each batch_kernel_*.cpp, which differ only in the
// compiler's flags. Only + - * / and the square root, without contraction, so that all levels agree
// to the bit. Branches are selections, since a lane of a vector cannot jump.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/rays/batch_kernel.h"

namespace vitreo::optics::detail {
namespace {

constexpr int kLanes = RayBlock::kSize;
// m: a path this short is rounding, a longer one means that the surfaces cross
constexpr double kBackwards = -1e-12;

#define VITREO_INLINE inline __attribute__((always_inline))
#ifdef __clang__
#define VITREO_LANES _Pragma("clang loop vectorize(enable)")
#else
#define VITREO_LANES _Pragma("GCC ivdep")
#endif

/// Intersection of a ray with a surface, and the normal there; all lengths from the vertex.
struct Intersection {
  double to_plane;  // along the ray to the vertex plane
  double px;        // where it crosses that plane
  double py;
  double s;  // from there on to the surface
  // a normal (any length, z > 0) and the direction's product with it
  double qx;
  double qy;
  double qz;
  double q;
  double code;  // why the ray is lost; 0 when it is not
};

struct Codes {
  double missed;
  double reflected;
  double clipped;
  double wrong_sheet;
  double no_convergence;
};

VITREO_INLINE double code_of(const KernelSurface& surface, int status) {
  return 8.0 * surface.number + status;
}

VITREO_INLINE Codes codes_of(const KernelSurface& f) {
  return {code_of(f, kLostMissed), code_of(f, kLostReflected), code_of(f, kLostClipped),
          code_of(f, kLostWrongSheet), code_of(f, kLostNoConvergence)};
}

/// s = E / (-B + sqrt(B^2 - A E)) as in system/refraction.h: no cancellation where A -> 0. With the
/// gradient of -F / 2 as the normal g, d . g is that same root.
VITREO_INLINE void meet_conic(const KernelSurface& f, const Codes& codes, double dx, double dy,
                              double dz, Intersection& m) {
  const double c = f.curvature;
  const double k1 = 1 + f.conic;
  const double a = c * (1.0 + f.conic * dz * dz);
  const double b = c * (m.px * dx + m.py * dy) - dz;
  const double e = c * (m.px * m.px + m.py * m.py);
  const double discriminant = b * b - a * e;
  const double root = __builtin_sqrt(discriminant);
  m.q = dz > 0.0 ? root : -root;
  const double denominator = m.q - b;
  m.s = e / denominator;
  const double depth = m.s * dz;
  m.code = k1 * c * depth > 1.0 ? codes.wrong_sheet : 0.0;
  m.code = !(discriminant >= 0.0) ? codes.missed : m.code;
  m.code = denominator == 0.0 ? codes.missed : m.code;
  m.qx = -c * (m.px + m.s * dx);
  m.qy = -c * (m.py + m.s * dy);
  m.qz = 1.0 - k1 * c * depth;
}

/// From the intersection on: clipping, Snell's law, the stop. With g the normal (any length), q = d
/// . g and mu the ratio of indices,
///  d' = mu d + g (+-sqrt(g^2 (1 - mu^2) + mu^2 q^2) - mu q) / g^2,
/// which is Snell's law in vector form with the normal's length multiplied out: one root and one
/// division. The codes are written in the order of their precedence, the last one wins.
template <bool kStop>
VITREO_INLINE void pass(const KernelSurface& f, const Codes& codes, const Intersection& m,
                        RayBlock& r, int i) {
  const double dx = r.dx[i];
  const double dy = r.dy[i];
  const double dz = r.dz[i];
  const double hx = m.px + m.s * dx;
  const double hy = m.py + m.s * dy;
  const double hz = m.s * dz;
  const double g2 = m.qx * m.qx + m.qy * m.qy + m.qz * m.qz;
  const double inside = g2 * (1.0 - f.ratio * f.ratio) + f.ratio * f.ratio * m.q * m.q;
  const double root = __builtin_sqrt(inside);
  const double bend = ((m.q < 0.0 ? -root : root) - f.ratio * m.q) / g2;
  const double ex = f.ratio * dx + bend * m.qx;
  const double ey = f.ratio * dy + bend * m.qy;
  const double ez = f.ratio * dz + bend * m.qz;
  double code = 0.0;
  double sx = 0.0;
  double sy = 0.0;
  if constexpr (kStop) {
    // The hole lies in the vertex plane: before the surface or behind it, by the sign of the sag.
    const bool plane_first = (hz >= 0.0) == (dz > 0.0);
    const double back = hz / ez;
    sx = plane_first ? m.px : hx - ex * back;
    sy = plane_first ? m.py : hy - ey * back;
    code = sx * sx + sy * sy > f.stop2 ? codes.clipped : code;
  }
  code = !(inside >= 0.0) ? codes.reflected : code;
  code = hx * hx + hy * hy > f.clip2 ? codes.clipped : code;
  code = !(m.to_plane + m.s > kBackwards) ? codes.missed : code;
  code = m.code != 0.0 ? m.code : code;
  code = dz == 0.0 ? codes.missed : code;
  const double before = r.lost[i];
  code = before != 0.0 ? before : code;
  const bool alive = code == 0.0;
  r.lost[i] = code;
  if constexpr (kStop) {
    r.stop_x[i] = before != 0.0 ? r.stop_x[i] : sx;
    r.stop_y[i] = before != 0.0 ? r.stop_y[i] : sy;
  }
  r.x[i] = alive ? hx : r.x[i];
  r.y[i] = alive ? hy : r.y[i];
  r.z[i] = alive ? hz + f.vertex : r.z[i];
  r.dx[i] = alive ? ex : dx;
  r.dy[i] = alive ? ey : dy;
  r.dz[i] = alive ? ez : dz;
}

/// The point where the ray crosses the vertex plane, in coordinates about the vertex.
VITREO_INLINE void to_vertex_plane(const KernelSurface& f, const RayBlock& r, int i,
                                   Intersection& m) {
  m.to_plane = -(r.z[i] - f.vertex) / r.dz[i];
  m.px = r.x[i] + m.to_plane * r.dx[i];
  m.py = r.y[i] + m.to_plane * r.dy[i];
}

template <bool kStop>
void cross_conic(const KernelSurface& f, RayBlock& r) {
  const Codes codes = codes_of(f);
  VITREO_LANES
  for (int i = 0; i < kLanes; ++i) {
    Intersection m;
    to_vertex_plane(f, r, i, m);
    meet_conic(f, codes, r.dx[i], r.dy[i], r.dz[i], m);
    pass<kStop>(f, codes, m, r, i);
  }
}

/// Profile (3.1) and (d sag / d r) / r; NaN where the conic part does not reach. Both share one
/// division: 1 / (1 + root) = root / (root + root^2) and 1 / root = (1 + root) / (root + root^2).
VITREO_INLINE void profile(const KernelSurface& f, double r2, double& sag, double& slope_over_r) {
  const double c = f.curvature;
  const double root = __builtin_sqrt(1.0 - (1 + f.conic) * c * c * r2);
  const double inverse = 1.0 / (root + root * root);
  sag = c * r2 * root * inverse + r2 * r2 * (f.a4 + r2 * (f.a6 + r2 * (f.a8 + r2 * f.a10)));
  slope_over_r = c * (1.0 + root) * inverse +
                 r2 * (4 * f.a4 + r2 * (6 * f.a6 + r2 * (8 * f.a8 + r2 * (10 * f.a10))));
}

struct NewtonLanes {
  alignas(64) double to_plane[kLanes];
  alignas(64) double px[kLanes];
  alignas(64) double py[kLanes];
  alignas(64) double s[kLanes];
  alignas(64) double state[kLanes];
};
/// States of a lane in Newton's method; numbers, so that vectors can compare them. kNowhere: no
/// intersection.
constexpr double kRunning = 0.0;
constexpr double kDone = 1.0;
constexpr double kNowhere = 2.0;

/// One Newton step for the lanes still running; returns how many still are. A lane is frozen by its
/// own test only, so its bits do not depend on its neighbors.
long long newton_step(const KernelSurface& f, const RayBlock& r, NewtonLanes& n) {
  // m: convergence is quadratic, so after such a step the error is below 1e-16 m
  constexpr double kSmallStep = 1e-10;
  VITREO_LANES
  for (int i = 0; i < kLanes; ++i) {
    const double dx = r.dx[i];
    const double dy = r.dy[i];
    const double dz = r.dz[i];
    const double s = n.s[i];
    const double x = n.px[i] + s * dx;
    const double y = n.py[i] + s * dy;
    double sag;
    double slope_over_r;
    profile(f, x * x + y * y, sag, slope_over_r);
    const double step = (s * dz - sag) / (dz - slope_over_r * (x * dx + y * dy));
    const double size = step < 0.0 ? -step : step;
    const bool running = n.state[i] == kRunning;
    double state = size < kSmallStep ? kDone : kRunning;
    state = !(size < 1e3) ? kNowhere : state;  // NaN, or a tangent
    n.s[i] = running ? s - step : s;
    n.state[i] = running ? state : n.state[i];
  }
  long long running = 0;
  for (int i = 0; i < kLanes; ++i) running += n.state[i] == kRunning ? 1 : 0;
  return running;
}

/// Aspheres: the conic's root as the start, Newton's method for all lanes, then refraction.
template <bool kStop>
void cross_asphere(const KernelSurface& f, RayBlock& r) {
  constexpr int kMaxSteps = 30;
  const Codes codes = codes_of(f);
  NewtonLanes n;
  VITREO_LANES
  for (int i = 0; i < kLanes; ++i) {
    Intersection m;
    to_vertex_plane(f, r, i, m);
    meet_conic(f, codes, r.dx[i], r.dy[i], r.dz[i], m);
    n.to_plane[i] = m.to_plane;
    n.px[i] = m.px;
    n.py[i] = m.py;
    n.s[i] = m.code != 0.0 ? 0.0 : m.s;  // where the conic is missed, start from the tangent plane
    n.state[i] = r.lost[i] != 0.0 ? kDone : kRunning;
  }
  for (int step = 0; step < kMaxSteps && newton_step(f, r, n) > 0; ++step) {
  }
  VITREO_LANES
  for (int i = 0; i < kLanes; ++i) {
    Intersection m;
    m.to_plane = n.to_plane[i];
    m.px = n.px[i];
    m.py = n.py[i];
    m.s = n.s[i];
    const double x = m.px + m.s * r.dx[i];
    const double y = m.py + m.s * r.dy[i];
    double sag;
    double slope_over_r;
    profile(f, x * x + y * y, sag, slope_over_r);
    m.qx = -slope_over_r * x;
    m.qy = -slope_over_r * y;
    m.qz = 1.0;
    m.q = r.dz[i] + m.qx * r.dx[i] + m.qy * r.dy[i];
    m.code = n.state[i] == kRunning ? codes.no_convergence : 0.0;
    m.code = n.state[i] == kNowhere ? codes.missed : m.code;
    pass<kStop>(f, codes, m, r, i);
  }
}

void trace_block(const KernelSurface* surfaces, int count, RayBlock& rays) {
  for (int k = 0; k < count; ++k) {
    const KernelSurface& f = surfaces[k];
    if (f.asphere) {
      f.holds_stop ? cross_asphere<true>(f, rays) : cross_asphere<false>(f, rays);
    } else {
      f.holds_stop ? cross_conic<true>(f, rays) : cross_conic<false>(f, rays);
    }
  }
}

#undef VITREO_INLINE
#undef VITREO_LANES

}  // namespace
}  // namespace vitreo::optics::detail
