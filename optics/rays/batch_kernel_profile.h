// Batch tracing kernel: the profiles of surfaces, and what its parts share; of the same kind as
// batch_kernel_body.h.
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

/// toric_profile of system/profile.h.
VITREO_INLINE void toric_profile(const KernelSurface& f, double x2, double y2, double& sag,
                                 double& slope_x, double& slope_y) {
  const double bent_x = (1 + f.conic) * f.curvature;
  const double bent_y = (1 + f.conic_y) * f.curvature_y;
  const double root = __builtin_sqrt(1.0 - bent_x * f.curvature * x2 - bent_y * f.curvature_y * y2);
  const double below = 1.0 + root;
  const double e = f.curvature * x2 + f.curvature_y * y2;
  const double bend = e / (root * below * below);
  const double r2 = x2 + y2;
  const double round = r2 * (4 * f.a4 + r2 * (6 * f.a6 + r2 * (8 * f.a8 + r2 * (10 * f.a10))));
  sag = e / below + r2 * r2 * (f.a4 + r2 * (f.a6 + r2 * (f.a8 + r2 * f.a10)));
  slope_x = f.curvature * (2.0 / below + bend * bent_x) + round;
  slope_y = f.curvature_y * (2.0 / below + bend * bent_y) + round;
}

/// The profile where the surface is met, and its derivatives by x and y over x and y.
template <bool kToric>
VITREO_INLINE void profile_at(const KernelSurface& f, double x, double y, double& sag,
                              double& slope_x, double& slope_y) {
  if constexpr (kToric) {
    toric_profile(f, x * x, y * y, sag, slope_x, slope_y);
  } else {
    profile(f, x * x + y * y, sag, slope_x);
    slope_y = slope_x;
  }
}

}  // namespace
}  // namespace vitreo::optics::detail
