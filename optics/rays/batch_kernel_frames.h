// Batch tracing kernel: rays in the frame of a surface and back; of the same kind as
// batch_kernel_body.h.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/rays/batch_kernel_profile.h"

namespace vitreo::optics::detail {
namespace {

/// A vector of the surface's frame, or with the transposed matrix one of the other frame.
struct Vector {
  double x;
  double y;
  double z;
};

VITREO_INLINE Vector rotated(const double* a, const Vector& v) {
  return {a[0] * v.x + a[1] * v.y + a[2] * v.z, a[3] * v.x + a[4] * v.y + a[5] * v.z,
          a[6] * v.x + a[7] * v.y + a[8] * v.z};
}

VITREO_INLINE Vector rotated_back(const double* a, const Vector& v) {
  return {a[0] * v.x + a[3] * v.y + a[6] * v.z, a[1] * v.x + a[4] * v.y + a[7] * v.z,
          a[2] * v.x + a[5] * v.y + a[8] * v.z};
}

/// The rays by the surface's frame.
void to_surface(const KernelSurface& f, const RayBlock& from, RayBlock& to) {
  VITREO_LANES
  for (int i = 0; i < kLanes; ++i) {
    const Vector at = rotated_back(
        f.axes, {from.x[i] - f.origin[0], from.y[i] - f.origin[1], from.z[i] - f.origin[2]});
    const Vector d = rotated_back(f.axes, {from.dx[i], from.dy[i], from.dz[i]});
    to.x[i] = at.x;
    to.y[i] = at.y;
    to.z[i] = at.z;
    to.dx[i] = d.x;
    to.dy[i] = d.y;
    to.dz[i] = d.z;
    to.lost[i] = from.lost[i];
    to.stop_x[i] = from.stop_x[i];
    to.stop_y[i] = from.stop_y[i];
  }
}

/// Back into the eye frame; directions are made unit again, as rounding adds up over frames. A lost
/// ray keeps its place in `to`; the stop is in its surface's own frame.
void from_surface(const KernelSurface& f, const RayBlock& from, RayBlock& to) {
  VITREO_LANES
  for (int i = 0; i < kLanes; ++i) {
    const bool alive = from.lost[i] == 0.0;
    const Vector at = rotated(f.axes, {from.x[i], from.y[i], from.z[i]});
    const Vector d = rotated(f.axes, {from.dx[i], from.dy[i], from.dz[i]});
    const double unit = 1.0 / __builtin_sqrt(d.x * d.x + d.y * d.y + d.z * d.z);
    const double old_x = to.x[i];
    to.x[i] = alive ? at.x + f.origin[0] : old_x;
    const double old_y = to.y[i];
    to.y[i] = alive ? at.y + f.origin[1] : old_y;
    const double old_z = to.z[i];
    to.z[i] = alive ? at.z + f.origin[2] : old_z;
    const double old_dx = to.dx[i];
    to.dx[i] = alive ? d.x * unit : old_dx;
    const double old_dy = to.dy[i];
    to.dy[i] = alive ? d.y * unit : old_dy;
    const double old_dz = to.dz[i];
    to.dz[i] = alive ? d.z * unit : old_dz;
    to.lost[i] = from.lost[i];
    to.stop_x[i] = from.stop_x[i];
    to.stop_y[i] = from.stop_y[i];
  }
}

}  // namespace
}  // namespace vitreo::optics::detail
