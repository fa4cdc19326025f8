// Batch tracing kernel: a block through any surface, with the status of each ray; of the same kind
// as batch_kernel_body.h. Branches are selections, since a lane of a vector cannot jump.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/rays/batch_kernel_gradient.h"
#include "optics/rays/batch_kernel_status.h"

namespace vitreo::optics::detail {
namespace {

/// Ratio of the indices where the ray meets the surface.
template <bool kGraded>
VITREO_INLINE double ratio_at(const KernelSurface& f, const Intersection& m) {
  if constexpr (kGraded)
    return index_at(f.before, m.x, m.y, m.z) / index_at(f.behind, m.x, m.y, m.z);
  return f.ratio;
}

template <bool kStop, bool kSphere, bool kGraded>
void cross_conic(const KernelSurface& f, RayBlock& rays) {
  const Codes codes = codes_of(f);
  VITREO_LANES
  for (int i = 0; i < kLanes; ++i) {
    const Lane lane = lane_of(f, rays, i);
    Intersection m;
    (void)meet_conic(f, lane, m);
    double met = (1 + f.conic) * f.curvature * m.z > 1.0 ? codes.wrong_sheet : 0.0;
    met = !(m.q * f.sense >= 0.0) ? codes.missed : met;
    met = !(m.x * m.x + m.y * m.y < kFarAside2) ? codes.missed : met;
    const Refracted r = refract<kStop, kSphere>(f, ratio_at<kGraded>(f, m), lane, m);
    store_carefully<kStop>(f, codes, m, r, met, i, rays);
  }
}

struct NewtonLanes {
  alignas(64) double s[kLanes];
  alignas(64) double slope_x[kLanes];
  alignas(64) double slope_y[kLanes];
  alignas(64) double state[kLanes];
};
/// States of a lane in Newton's method; numbers, so that vectors can compare them. kNowhere: no
/// intersection.
constexpr double kRunning = 0.0;
constexpr double kDone = 1.0;
constexpr double kNowhere = 2.0;

/// One step for the lanes still running; returns how many still are. A lane is frozen by its own
/// test only, so its bits do not depend on its neighbors.
template <bool kToric>
long long step_lanes(const KernelSurface& f, const RayBlock& rays, bool least, NewtonLanes& n) {
  VITREO_LANES
  for (int i = 0; i < kLanes; ++i) {
    const Lane lane = lane_of(f, rays, i);
    const double s = n.s[i];
    Slopes slopes;
    const double step = newton_step<kToric>(f, lane, s, slopes);
    const double size = step < 0.0 ? -step : step;
    const bool running = n.state[i] == kRunning;
    double state = (size < kSmallStep) & !least ? kDone : kRunning;
    state = !(size < kFarAway) ? kNowhere : state;  // NaN, or a tangent
    n.s[i] = running ? s - step : s;
    n.slope_x[i] = running ? slopes.x : n.slope_x[i];
    n.slope_y[i] = running ? slopes.y : n.slope_y[i];
    n.state[i] = running ? state : n.state[i];
  }
  long long running = 0;
  for (int i = 0; i < kLanes; ++i) running += n.state[i] == kRunning ? 1 : 0;
  return running;
}

/// Aspheres and toric surfaces: the conic's root as the start, Newton's method, then refraction.
template <bool kStop, bool kToric, bool kGraded>
void cross_asphere(const KernelSurface& f, RayBlock& rays) {
  const Codes codes = codes_of(f);
  NewtonLanes n;
  VITREO_LANES
  for (int i = 0; i < kLanes; ++i) {
    const Lane lane = lane_of(f, rays, i);
    Intersection m;
    const double s = meet_conic(f, lane, m);
    bool met = m.q * f.sense >= 0.0;
    met = met & ((1 + f.conic) * f.curvature * m.z <= 1.0) & !kToric;
    // where the conic is missed or none, start from the tangent plane
    n.s[i] = met ? s : -lane.pz / lane.dz;
    n.slope_x[i] = 0.0;
    n.slope_y[i] = 0.0;
    n.state[i] = rays.lost[i] != 0.0 ? kDone : kRunning;
  }
  for (int step = 1; step <= kMostSteps; ++step) {
    if (step_lanes<kToric>(f, rays, step < kLeastSteps, n) == 0) break;
  }
  VITREO_LANES
  for (int i = 0; i < kLanes; ++i) {
    const Lane lane = lane_of(f, rays, i);
    Intersection m;
    stand_on(lane, n.s[i], {n.slope_x[i], n.slope_y[i]}, m);
    double met = n.state[i] == kRunning ? codes.no_convergence : 0.0;
    met = n.state[i] == kNowhere ? codes.missed : met;
    const Refracted r = refract<kStop, false>(f, ratio_at<kGraded>(f, m), lane, m);
    store_carefully<kStop>(f, codes, m, r, met, i, rays);
  }
}

template <bool kStop, bool kGraded>
void cross_any(const KernelSurface& f, RayBlock& rays) {
  if (f.toric) {
    cross_asphere<kStop, true, kGraded>(f, rays);
  } else if (f.asphere) {
    cross_asphere<kStop, false, kGraded>(f, rays);
  } else if (f.conic == 0.0) {
    cross_conic<kStop, true, kGraded>(f, rays);
  } else {
    cross_conic<kStop, false, kGraded>(f, rays);
  }
}

template <bool kGraded>
void cross_any(const KernelSurface& f, RayBlock& rays) {
  f.holds_stop ? cross_any<true, kGraded>(f, rays) : cross_any<false, kGraded>(f, rays);
}

/// Any surface. One off the axis, toric, or beside a gradient is met in its own frame, on a copy,
/// so that rays that are lost stay where they were.
void cross_carefully(const KernelSurface& f, RayBlock& rays) {
  if (!f.skew) return cross_any<false>(f, rays);
  RayBlock local;
  to_surface(f, rays, local);
  if (f.graded_before) f.toric ? march<true>(f, local) : march<false>(f, local);
  f.graded ? cross_any<true>(f, local) : cross_any<false>(f, local);
  from_surface(f, local, rays);
}

}  // namespace
}  // namespace vitreo::optics::detail
