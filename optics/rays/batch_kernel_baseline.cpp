// The batch tracing kernel compiled for baseline; kernels.cmake gives the flags.
// SPDX-License-Identifier: Apache-2.0
#include "optics/rays/batch_kernel_body.h"

namespace vitreo::optics::detail {

void trace_block_baseline(const KernelSurface* surfaces, int count, RayBlock* rays) {
  trace_block(surfaces, count, *rays);
}

}  // namespace vitreo::optics::detail
