// Batch tracing kernel: the arithmetic of system/refraction.h over 64 rays, written so that the
// compiler makes vectors of it. Included once by each batch_kernel_*.cpp, which differ only in the
// compiler's flags. Only + - * / and the square root, without contraction, so that all levels agree
// to the bit. A block is first taken through a surface as if every ray met it; where one does not,
// again with the status of each (batch_kernel_careful.h): both ways have the same bits.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/rays/batch_kernel_careful.h"

namespace vitreo::optics::detail {
namespace {

VITREO_INLINE double least(double a, double b) { return a < b ? a : b; }

/// Positive where a lane that went through without tests may have: the least of what must be
/// positive. A root of something negative makes all that follows NaN, the direction too, and then
/// the least, as its last part is.
template <bool kStop>
VITREO_INLINE double soundness(const KernelSurface& f, const Intersection& m, const Refracted& r) {
  const double r2 = m.x * m.x + m.y * m.y;
  double sound = least(least(f.clip2, kFarAside2) - r2, m.s - kBackwards);
  if constexpr (kStop) sound = least(sound, f.stop2 - (r.stop_x * r.stop_x + r.stop_y * r.stop_y));
  return least(sound, r.dz * f.sense);
}

/// Writes the lane behind the surface to `to`.
template <bool kStop>
VITREO_INLINE void store(const KernelSurface& f, const Intersection& m, const Refracted& r, int i,
                         RayBlock& to, RayBlock& stop) {
  to.x[i] = m.x;
  to.y[i] = m.y;
  to.z[i] = m.z + f.vertex;
  to.dx[i] = r.dx;
  to.dy[i] = r.dy;
  to.dz[i] = r.dz;
  if constexpr (kStop) {
    stop.stop_x[i] = r.stop_x;
    stop.stop_y[i] = r.stop_y;
  }
}

/// In eight partial results, which a vector can hold.
bool all_positive(const double* values) {
  double bad[8] = {};
  for (int i = 0; i < kLanes; i += 8) {
    for (int j = 0; j < 8; ++j) bad[j] = values[i + j] > 0.0 ? bad[j] : 1.0;
  }
  double sum = 0;
  for (int j = 0; j < 8; ++j) sum += bad[j];
  return sum == 0.0;
}

/// Between the passes over a block. Each pass is short: what bounds a long one is not the number of
/// its instructions but the chain of roots and divisions, of which the processor then holds too few
/// lanes at once.
struct Work {
  alignas(64) double ahead[kLanes];
  alignas(64) double px[kLanes];
  alignas(64) double py[kLanes];
  alignas(64) double pz[kLanes];
  alignas(64) double s[kLanes];
  alignas(64) double q[kLanes];        // of an asphere the size of the last step
  alignas(64) double slope_x[kLanes];  // of surfaces of revolution, so that along y too
  alignas(64) double sound[kLanes];
};

VITREO_INLINE Lane lane_in(const Work& w, const RayBlock& from, int i) {
  return {from.dx[i], from.dy[i], from.dz[i], w.ahead[i], w.px[i], w.py[i], w.pz[i]};
}

void meet_conics(const KernelSurface& f, const RayBlock& from, Work& w) {
  VITREO_LANES
  for (int i = 0; i < kLanes; ++i) {
    const Lane lane = lane_of(f, from, i);
    Intersection m;
    w.s[i] = meet_conic(f, lane, m);
    w.q[i] = m.q;
    w.ahead[i] = lane.ahead;
    w.px[i] = lane.px;
    w.py[i] = lane.py;
    w.pz[i] = lane.pz;
    // (3.1) is the sheet where its square root, 1 - (1 + k) c z, is positive.
    w.sound[i] = 1.0 - (1 + f.conic) * f.curvature * m.z;
  }
}

/// The whole block through a conic; false when a lane was not sound. With `kSphere` the normal has
/// unit length and needs no division.
template <bool kStop, bool kSphere>
bool pass_conic(const KernelSurface& f, const RayBlock& from, RayBlock& to, RayBlock& stop) {
  Work w;
  meet_conics(f, from, w);
  VITREO_LANES
  for (int i = 0; i < kLanes; ++i) {
    const Lane lane = lane_in(w, from, i);
    Intersection m;
    m.q = w.q[i];
    stand_on_conic(f, lane, w.s[i], m);
    const Refracted r = refract<kStop, kSphere>(f, f.ratio, lane, m);
    w.sound[i] = least(w.sound[i], soundness<kStop>(f, m, r));
    store<kStop>(f, m, r, i, to, stop);
  }
  return all_positive(w.sound);
}

void newton_steps(const KernelSurface& f, const RayBlock& from, Work& w) {
  VITREO_LANES
  for (int i = 0; i < kLanes; ++i) {
    Slopes slopes;
    const double step = newton_step<false>(f, lane_in(w, from, i), w.s[i], slopes);
    w.s[i] -= step;
    w.slope_x[i] = slopes.x;
    w.q[i] = step < 0.0 ? -step : step;
  }
}

/// The same through an asphere whose intersection is found in the fewest steps.
template <bool kStop>
bool pass_asphere(const KernelSurface& f, const RayBlock& from, RayBlock& to, RayBlock& stop) {
  Work w;
  meet_conics(f, from, w);
  for (int k = 0; k < kLeastSteps; ++k) newton_steps(f, from, w);
  VITREO_LANES
  for (int i = 0; i < kLanes; ++i) {
    const Lane lane = lane_in(w, from, i);
    Intersection m;
    stand_on(lane, w.s[i], {w.slope_x[i], w.slope_x[i]}, m);
    const Refracted r = refract<kStop, false>(f, f.ratio, lane, m);
    const double found = least(least(w.sound[i], kSmallStep - w.q[i]), m.q * f.sense);
    w.sound[i] = least(found, soundness<kStop>(f, m, r));
    store<kStop>(f, m, r, i, to, stop);
  }
  return all_positive(w.sound);
}

bool pass_all(const KernelSurface& f, const RayBlock& from, RayBlock& to, RayBlock& stop) {
  if (f.asphere) {
    return f.holds_stop ? pass_asphere<true>(f, from, to, stop)
                        : pass_asphere<false>(f, from, to, stop);
  }
  if (f.conic == 0.0) {
    return f.holds_stop ? pass_conic<true, true>(f, from, to, stop)
                        : pass_conic<false, true>(f, from, to, stop);
  }
  return f.holds_stop ? pass_conic<true, false>(f, from, to, stop)
                      : pass_conic<false, false>(f, from, to, stop);
}

/// Place and direction, without what `rays` alone has: status and stop.
void copy_rays(const RayBlock& from, RayBlock& to) {
  for (int i = 0; i < kLanes; ++i) {
    to.x[i] = from.x[i];
    to.y[i] = from.y[i];
    to.z[i] = from.z[i];
    to.dx[i] = from.dx[i];
    to.dy[i] = from.dy[i];
    to.dz[i] = from.dz[i];
  }
}

bool all_alive(const RayBlock& rays) {
  long long lost = 0;
  for (int i = 0; i < kLanes; ++i) lost += rays.lost[i] != 0.0 ? 1 : 0;
  return lost == 0;
}

/// The rays go back and forth between two blocks, so that a surface that not all of them pass can
/// be crossed again from before it.
void trace_block(const KernelSurface* surfaces, int count, RayBlock& rays) {
  RayBlock other;
  RayBlock* from = &rays;
  RayBlock* to = &other;
  bool alive = all_alive(rays);
  for (int k = 0; k < count; ++k) {
    const KernelSurface& f = surfaces[k];
    if (alive && !f.skew && pass_all(f, *from, *to, rays)) {
      RayBlock* const before = from;
      from = to;
      to = before;
      continue;
    }
    if (from != &rays) {
      copy_rays(*from, rays);
      from = &rays;
      to = &other;
    }
    cross_carefully(f, rays);
    alive = all_alive(rays);
  }
  if (from != &rays) copy_rays(*from, rays);
}

#undef VITREO_INLINE
#undef VITREO_LANES

}  // namespace
}  // namespace vitreo::optics::detail
