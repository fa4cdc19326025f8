// What the batch tracing kernel is given: plain data, so that it can be compiled once per CPU
// level. No function with external linkage that could be inlined may stand here: the linker would
// keep one level's copy for all.
// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace vitreo::optics {

/// 64 rays, one array a component; eye frame, m, directions of unit length.
struct RayBlock {
  static constexpr int kSize = 64;
  alignas(64) double x[kSize], y[kSize], z[kSize];  // a point of the ray; behind a surface: on it
  alignas(64) double dx[kSize], dy[kSize], dz[kSize];  // its direction
  alignas(64) double lost[kSize];  // 0: alive; else 8 * surface + status, as a number that vectors
                                   // can compare
  alignas(64) double stop_x[kSize],
      stop_y[kSize];  // where it crossed the stop's plane, if it came so far
};

namespace detail {

struct KernelSurface {
  double vertex;            // m
  double curvature, conic;  // 1/m
  double a4, a6, a8, a10;   // m^-3 ...
  double ratio;             // index before / index behind, as the rays go
  double clip2, stop2;      // m^2, squared radii; infinite when there is none
  int number;               // counted from 1, the retina
  bool asphere, holds_stop;
};

/// TraceStatus as the kernel writes it.
constexpr int kLostMissed = 1, kLostReflected = 2, kLostClipped = 3, kLostWrongSheet = 4,
              kLostNoConvergence = 5;

/// Takes all rays of the block through the surfaces in the order given. A lost ray stays where it
/// was lost.
using TraceBlock = void (*)(const KernelSurface* surfaces, int count, RayBlock* rays);
void trace_block_baseline(const KernelSurface* surfaces, int count, RayBlock* rays);
void trace_block_avx2(const KernelSurface* surfaces, int count, RayBlock* rays);
void trace_block_avx512(const KernelSurface* surfaces, int count, RayBlock* rays);

}  // namespace detail
}  // namespace vitreo::optics
