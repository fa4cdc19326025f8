// Measured bench: a drawn bench's viewing chain calibrated by both cameras, as calibrate_bench
// does, in the file that a rig's model.chain takes. No loop, no clock.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "tests/bench/records/drawn_bench.h"

#include <optional>
#include <string>

namespace vitreo::records {

/// By pictures at `places` places whose x and z a side camera has to 15 um. Nothing where no chain
/// explains them.
std::optional<std::string> measured_file(DrawnBench& bench, int places, std::uint64_t seed);

/// What the loop's model becomes by it.
std::optional<RigModel> measured_model(DrawnBench& bench, int places, std::uint64_t seed);

}  // namespace vitreo::records
