// Batch ray tracer: exact traces of many rays at once by the vector instructions of the CPU.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/rays/batch_kernel.h"
#include "optics/rays/trace.h"

#include <vector>

namespace vitreo::optics {

/// What the kernel is compiled for. All levels give the same bits.
enum class CpuLevel { baseline, avx2, avx512 };
const char* to_string(CpuLevel level);
/// Those that this machine has, in ascending order.
std::vector<CpuLevel> cpu_levels();
CpuLevel best_cpu_level();

/// Sets ray i (0 to 63) of a block to a ray that is not lost.
void put(RayBlock& block, int i, const Ray& ray);
/// Ray i in its present state; a lost ray is the one before the surface that lost it.
TraceResult result(const RayBlock& block, int i);

/// Any number of rays, in blocks; the last one is filled up with rays along the axis.
class RayBatch {
 public:
  explicit RayBatch(int count);  // throws std::invalid_argument when negative
  int size() const { return size_; }
  void put(int i, const Ray& ray) {
    optics::put(blocks_[i / RayBlock::kSize], i % RayBlock::kSize, ray);
  }
  TraceResult result(int i) const {
    return optics::result(blocks_[i / RayBlock::kSize], i % RayBlock::kSize);
  }
  std::vector<RayBlock>& blocks() { return blocks_; }

 private:
  int size_;
  std::vector<RayBlock> blocks_;
};

/// Traces as trace_out and trace_in do, to rounding, but never throws for a ray: one that is not
/// finite, not of unit length or goes the wrong way is `missed` at the first surface. No heap and
/// no virtual call per ray.
class BatchTracer {
 public:
  /// Throws std::invalid_argument as System::check, and when the machine has not that level.
  explicit BatchTracer(const System& system, CpuLevel level = best_cpu_level());
  void trace_out(RayBlock& rays) const { trace(outwards_, outwards_.size(), true, rays); }
  void trace_in(RayBlock& rays) const { trace(inwards_, inwards_.size(), false, rays); }
  void trace_out(RayBatch& rays) const;
  void trace_in(RayBatch& rays) const;
  /// Outwards up to and with the stop's surface, by a stop that lets everything through: stop_x and
  /// stop_y are set. Throws std::invalid_argument when there is no stop.
  void trace_through_stop(RayBlock& rays) const;
  /// Outwards through the surfaces before the stop's.
  void trace_before_stop(RayBlock& rays) const;

 private:
  void trace(const std::vector<detail::KernelSurface>& surfaces, std::size_t count, bool outwards,
             RayBlock& rays) const;
  detail::TraceBlock kernel_;
  std::vector<detail::KernelSurface> outwards_;
  std::vector<detail::KernelSurface> inwards_;
  std::vector<detail::KernelSurface> to_stop_;
};

}  // namespace vitreo::optics
