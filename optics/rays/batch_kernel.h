// Data of the batch tracing kernel: plain structs, so that it can be compiled once per CPU level.
// No function with external linkage that could be inlined may stand here: the linker would keep one
// level's copy for all.
// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace vitreo::optics {

/// 64 rays, one array a component; eye frame, m, directions of unit length.
struct RayBlock {
  static constexpr int kSize = 64;
  // a point of the ray; behind a surface: on it
  alignas(64) double x[kSize];
  alignas(64) double y[kSize];
  alignas(64) double z[kSize];
  // its direction
  alignas(64) double dx[kSize];
  alignas(64) double dy[kSize];
  alignas(64) double dz[kSize];
  // 0: alive; else 8 * surface + status, as a number that vectors can compare
  alignas(64) double lost[kSize];
  // where it crossed the stop's plane, if it came so far
  alignas(64) double stop_x[kSize];
  alignas(64) double stop_y[kSize];
};

namespace detail {

/// Steps of Runge and Kutta's method to a surface's vertex plane, half as many from there to the
/// surface along the tangent, and at most so many of Newton's at its end.
constexpr int kGradientSteps = 16;
constexpr int kGradientNewton = 8;

/// A medium with a gradient; its frame by that of the surface that the rays meet next.
struct KernelGradient {
  double index;
  double along[4];   // m^-1 to m^-4
  double across[3];  // m^-2, m^-4, m^-6
  double axes[9];    // medium_from_surface, by rows
  double origin[3];  // m: medium = axes surface + origin
};

struct KernelSurface {
  double vertex;     // m
  double curvature;  // 1/m
  double conic;
  double a4;     // m^-3
  double a6;     // m^-5
  double a8;     // m^-7
  double a10;    // m^-9
  double ratio;  // index before / index behind, as the rays go
  // m^2, squared radii; infinite when there is none
  double clip2;
  double stop2;
  double sense;  // of travel along z, 1 or -1
  int number;    // counted from 1, the retina
  bool asphere;
  bool holds_stop;
  // What follows counts for skew surfaces alone: those off the axis, toric ones, and those beside a
  // gradient. They are met in their own frame, with `vertex` 0.
  bool skew;
  bool toric;
  bool graded;         // on either side; `before` and `behind` are set
  bool graded_before;  // rays come to it along curves
  double curvature_y;
  double conic_y;
  double axes[9];    // eye_from_surface, by rows
  double origin[3];  // m, the vertex in the eye frame
  KernelGradient before;
  KernelGradient behind;
};

/// TraceStatus as the kernel writes it.
constexpr int kLostMissed = 1;
constexpr int kLostReflected = 2;
constexpr int kLostClipped = 3;
constexpr int kLostWrongSheet = 4;
constexpr int kLostNoConvergence = 5;

/// Takes all rays of the block through the surfaces in the order given. A lost ray stays where it
/// was lost.
using TraceBlock = void (*)(const KernelSurface* surfaces, int count, RayBlock* rays);
void trace_block_baseline(const KernelSurface* surfaces, int count, RayBlock* rays);
void trace_block_avx2(const KernelSurface* surfaces, int count, RayBlock* rays);
void trace_block_avx512(const KernelSurface* surfaces, int count, RayBlock* rays);

}  // namespace detail
}  // namespace vitreo::optics
