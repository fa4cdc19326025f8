// SPDX-License-Identifier: Apache-2.0
#include "optics/rays/batch.h"

#include "optics/numerics/preconditions.h"
#include "optics/system/frames.h"
#include "optics/system/refraction.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

namespace vitreo::optics {
namespace {

/// The kernel's header must stay free of shared code, so its codes are plain numbers; here they are
/// held equal to TraceStatus.
static_assert(static_cast<int>(TraceStatus::missed) == detail::kLostMissed);
static_assert(static_cast<int>(TraceStatus::total_reflection) == detail::kLostReflected);
static_assert(static_cast<int>(TraceStatus::clipped) == detail::kLostClipped);
static_assert(static_cast<int>(TraceStatus::wrong_sheet) == detail::kLostWrongSheet);
static_assert(static_cast<int>(TraceStatus::no_convergence) == detail::kLostNoConvergence);

constexpr int kStatuses = 8;  // a loss is kStatuses * surface + status

/// The instruction sets that kernels.cmake compiles each level for.
/// By the processor, and for AVX by the operating system too, which must save the wide registers.
bool machine_has(CpuLevel level) {
  switch (level) {
    case CpuLevel::baseline:
      return true;
    case CpuLevel::avx2:
      return __builtin_cpu_supports("avx2");
    case CpuLevel::avx512:
      return __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
             __builtin_cpu_supports("avx512vl");
  }
  return false;
}

/// Refused by name where the machine lacks it; the kernel itself would end the program by an
/// illegal instruction.
detail::TraceBlock kernel_for(CpuLevel level) {
  if (!machine_has(level)) {
    throw std::invalid_argument(std::string("level: this machine has no ") + to_string(level));
  }
  if (level == CpuLevel::avx512) return detail::trace_block_avx512;
  return level == CpuLevel::avx2 ? detail::trace_block_avx2 : detail::trace_block_baseline;
}

void set_rows(const Eigen::Matrix3d& axes, double* rows) {
  Eigen::Map<Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>{rows} = axes;
}

/// The medium behind surface `number`, in the frame of the surface `at` that the rays meet.
detail::KernelGradient gradient_of(const System& system, int number, const SurfaceFrame& at) {
  const Surface& surface = system.surfaces[number - 1];
  const SurfaceFrame frame = surface_frame(system, number);
  detail::KernelGradient made{};
  made.index = surface.index;
  std::copy(surface.gradient.along.begin(), surface.gradient.along.end(), made.along);
  std::copy(surface.gradient.across.begin(), surface.gradient.across.end(), made.across);
  set_rows(frame.axes.transpose() * at.axes, made.axes);
  Eigen::Vector3d::Map(made.origin) = frame.to_local(at.origin);
  return made;
}

/// What only surfaces off the axis, toric ones and those beside a gradient have; `made` is then met
/// in its own frame.
void compile_skew(const System& system, int number, bool outwards, detail::KernelSurface& made) {
  const Surface& surface = system.surfaces[number - 1];
  const int before = number - (outwards ? 1 : 0);
  const int behind = number - (outwards ? 0 : 1);
  made.graded_before = !system.surfaces[before - 1].gradient.is_none();
  made.graded = made.graded_before || !system.surfaces[behind - 1].gradient.is_none();
  made.toric = surface.is_toric();
  made.skew = made.toric || made.graded || !surface.placement.is_none();
  if (!made.skew) return;
  const SurfaceFrame frame = surface_frame(system, number);
  set_rows(frame.axes, made.axes);
  Eigen::Vector3d::Map(made.origin) = frame.origin;
  made.vertex = 0;
  made.curvature_y = made.toric ? 1 / surface.radius_y : made.curvature;
  made.conic_y = made.toric ? surface.conic_y : made.conic;
  made.before = gradient_of(system, before, frame);
  made.behind = gradient_of(system, behind, frame);
}

/// A surface as the kernel takes it: curvature for radius, squared radii for comparisons, the ratio
/// of indices in the direction of travel.
/// A plane's curvature is 1 / infinity = 0, and a rim of infinite radius clips nothing, so neither
/// is a special case in the kernel.
detail::KernelSurface compile(const System& system, int number, double vertex, bool outwards) {
  const Surface& surface = system.surfaces[number - 1];
  const double before = system.surfaces[number - 2].index;
  const double behind = surface.index;
  detail::KernelSurface made{};
  made.vertex = vertex;
  made.curvature = 1 / surface.radius;
  made.conic = surface.conic;
  made.a4 = surface.aspheric[0];
  made.a6 = surface.aspheric[1];
  made.a8 = surface.aspheric[2];
  made.a10 = surface.aspheric[3];
  made.ratio = outwards ? before / behind : behind / before;
  made.clip2 = surface.semi_diameter * surface.semi_diameter;
  made.holds_stop = system.stop && system.stop->surface == number;
  made.stop2 = made.holds_stop ? system.stop->radius * system.stop->radius
                               : std::numeric_limits<double>::infinity();
  made.sense = outwards ? 1 : -1;
  made.number = number;
  made.asphere = detail::is_asphere(surface);
  compile_skew(system, number, outwards, made);
  return made;
}

/// Marks rays that cannot be traced as missed, where trace_out would throw. Written with & and
/// selections for the vectorizer.
/// They are lost at the first surface of their way. The kernel takes unit directions and finite
/// numbers for granted.
void refuse_bad_rays(bool outwards, int surface, RayBlock& r) {
  // Of |d|^2, as trace_out.
  constexpr double kUnit = 1e-6;
  const double missed = kStatuses * surface + detail::kLostMissed;
  const double sign = outwards ? 1 : -1;
  for (int i = 0; i < RayBlock::kSize; ++i) {
    const double off = std::abs(r.dx[i] * r.dx[i] + r.dy[i] * r.dy[i] + r.dz[i] * r.dz[i] - 1);
    const double nothing = 0 * (r.x[i] + r.y[i] + r.z[i]);  // NaN where one is not finite
    const bool good = (off < kUnit) & (r.dz[i] * sign > 0) & (nothing == 0);
    r.lost[i] = r.lost[i] == 0 && !good ? missed : r.lost[i];
  }
}

}  // namespace

const char* to_string(CpuLevel level) {
  switch (level) {
    case CpuLevel::baseline:
      return "baseline";
    case CpuLevel::avx2:
      return "avx2";
    case CpuLevel::avx512:
      return "avx512";
  }
  return "unknown";
}

std::vector<CpuLevel> cpu_levels() {
  std::vector<CpuLevel> levels;
  for (const CpuLevel level : {CpuLevel::baseline, CpuLevel::avx2, CpuLevel::avx512}) {
    if (machine_has(level)) levels.push_back(level);
  }
  return levels;
}

/// All levels agree to the bit, so the choice is one of speed alone.
CpuLevel best_cpu_level() {
  if (machine_has(CpuLevel::avx512)) return CpuLevel::avx512;
  return machine_has(CpuLevel::avx2) ? CpuLevel::avx2 : CpuLevel::baseline;
}

/// Alive and without a crossing of the stop, since blocks are filled again and again.
void put(RayBlock& block, int i, const Ray& ray) {
  block.x[i] = ray.origin.x();
  block.y[i] = ray.origin.y();
  block.z[i] = ray.origin.z();
  block.dx[i] = ray.direction.x();
  block.dy[i] = ray.direction.y();
  block.dz[i] = ray.direction.z();
  block.lost[i] = block.stop_x[i] = block.stop_y[i] = 0;
}

/// The code 8 * surface + status taken apart.
TraceResult result(const RayBlock& block, int i) {
  TraceResult made;
  made.ray = {{block.x[i], block.y[i], block.z[i]}, {block.dx[i], block.dy[i], block.dz[i]}};
  const int code = static_cast<int>(block.lost[i]);
  made.status = static_cast<TraceStatus>(code % kStatuses);
  made.surface = code / kStatuses;
  return made;
}

/// Whole blocks: the last one may have lanes that no ray was put into.
RayBatch::RayBatch(int count) : size_(count) {
  detail::require(count >= 0, "count: must not be negative");
  blocks_.resize(static_cast<std::size_t>((count + RayBlock::kSize - 1) / RayBlock::kSize));
  for (RayBlock& block : blocks_) {
    // A ray along the axis meets every surface, so the unused lanes of the last block need no
    // special case.
    for (int i = 0; i < RayBlock::kSize; ++i) optics::put(block, i, {{0, 0, 0}, {0, 0, 1}});
  }
}

/// Compiles the system three times: outwards, inwards with the ratios inverted, and up to the stop.
BatchTracer::BatchTracer(const System& system, CpuLevel level) : kernel_(kernel_for(level)) {
  system.check();
  double vertex = 0;
  for (int number = 2; number <= system.size(); ++number) {
    vertex += system.surfaces[number - 2].thickness;
    outwards_.push_back(compile(system, number, vertex, true));
    inwards_.push_back(compile(system, number, vertex, false));
    if (system.stop && number <= system.stop->surface) to_stop_.push_back(outwards_.back());
  }
  std::reverse(inwards_.begin(), inwards_.end());
  // The stop is filled by aiming; here it must not clip the rays that are still being aimed.
  if (!to_stop_.empty()) to_stop_.back().stop2 = std::numeric_limits<double>::infinity();
}

/// `surfaces` in the order of travel; the rays are tested first, as the kernel does not.
void BatchTracer::trace(const std::vector<detail::KernelSurface>& surfaces, std::size_t count,
                        bool outwards, RayBlock& rays) const {
  refuse_bad_rays(outwards, outwards ? 2 : surfaces.front().number, rays);
  kernel_(surfaces.data(), static_cast<int>(count), &rays);
}

/// Up to and through the stop's own surface; the rays then stand behind it.
void BatchTracer::trace_through_stop(RayBlock& rays) const {
  if (to_stop_.empty()) throw std::invalid_argument("stop: the system has none");
  trace(to_stop_, to_stop_.size(), true, rays);
}

/// The last of to_stop_ is the stop's own surface.
/// So the rays are those that reach the plane of the stop from before, whichever side of its
/// surface that plane is on.
void BatchTracer::trace_before_stop(RayBlock& rays) const {
  if (to_stop_.empty()) throw std::invalid_argument("stop: the system has none");
  trace(to_stop_, to_stop_.size() - 1, true, rays);
}

void BatchTracer::trace_out(RayBatch& rays) const {
  for (RayBlock& block : rays.blocks()) trace_out(block);
}

void BatchTracer::trace_in(RayBatch& rays) const {
  for (RayBlock& block : rays.blocks()) trace_in(block);
}

}  // namespace vitreo::optics
