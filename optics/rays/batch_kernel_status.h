// Batch tracing kernel: Newton's method of a lane, and the status of a ray; of the same kind as
// batch_kernel_body.h.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/rays/batch_kernel_lane.h"

namespace vitreo::optics::detail {
namespace {

/// (d sag / dx) / x and the same for y.
struct Slopes {
  double x;
  double y;
};

/// m: convergence is quadratic, so slopes that are found with such a step are exact to rounding
constexpr double kSmallStep = 1e-15;
constexpr int kLeastSteps = 3;
constexpr int kMostSteps = 30;

/// A step of Newton's method on f(s) = z - sag(x, y), to be taken off s.
template <bool kToric>
VITREO_INLINE double newton_step(const KernelSurface& f, const Lane& l, double s, Slopes& slopes) {
  const double x = l.px + s * l.dx;
  const double y = l.py + s * l.dy;
  double sag;
  profile_at<kToric>(f, x, y, sag, slopes.x, slopes.y);
  return (l.pz + s * l.dz - sag) / (l.dz - (slopes.x * (x * l.dx) + slopes.y * (y * l.dy)));
}

VITREO_INLINE void stand_on(const Lane& l, double s, const Slopes& slopes, Intersection& m) {
  m.s = l.ahead + s;
  m.x = l.px + s * l.dx;
  m.y = l.py + s * l.dy;
  m.z = l.pz + s * l.dz;
  m.gx = -slopes.x * m.x;
  m.gy = -slopes.y * m.y;
  m.gz = 1.0;
  m.q = l.dz + m.gx * l.dx + m.gy * l.dy;
}

/// m; no ray of an eye goes so far, so this is NaN, infinity or a tangent
constexpr double kFarAway = 1e3;
constexpr double kFarAside2 = kFarAway * kFarAway;  // m^2

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

/// The lane behind the surface with its status, `met` why it did not meet it. The codes are written
/// in the order of their precedence, the last one wins.
template <bool kStop>
VITREO_INLINE void store_carefully(const KernelSurface& f, const Codes& codes,
                                   const Intersection& m, const Refracted& r, double met, int i,
                                   RayBlock& rays) {
  double code = 0.0;
  if constexpr (kStop)
    code = r.stop_x * r.stop_x + r.stop_y * r.stop_y > f.stop2 ? codes.clipped : code;
  // On the other side of the normal there is the other sheet, or a surface that turns away.
  code = !(r.inside >= 0.0) ? codes.reflected : code;
  code = m.x * m.x + m.y * m.y > f.clip2 ? codes.clipped : code;
  code = !(m.s > kBackwards) ? codes.missed : code;
  code = met != 0.0 ? met : code;
  code = !(rays.dz[i] * f.sense > 0.0) ? codes.missed : code;
  const double before = rays.lost[i];
  code = before != 0.0 ? before : code;
  const bool alive = code == 0.0;
  rays.lost[i] = code;
  if constexpr (kStop) {
    rays.stop_x[i] = before != 0.0 ? rays.stop_x[i] : r.stop_x;
    rays.stop_y[i] = before != 0.0 ? rays.stop_y[i] : r.stop_y;
  }
  rays.x[i] = alive ? m.x : rays.x[i];
  rays.y[i] = alive ? m.y : rays.y[i];
  rays.z[i] = alive ? m.z + f.vertex : rays.z[i];
  rays.dx[i] = alive ? r.dx : rays.dx[i];
  rays.dy[i] = alive ? r.dy : rays.dy[i];
  rays.dz[i] = alive ? r.dz : rays.dz[i];
}

}  // namespace
}  // namespace vitreo::optics::detail
