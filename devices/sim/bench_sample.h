// Bench sample: an optics sample of a bench that is worked on, as the microscope looks through the
// eye's pupil.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/sim/optics_sample.h"

#include <cstdint>

namespace vitreo::sim {

/// The first sample of a row that the seed begins by which the picture's middle, and the points
/// half-way to its edges, show the inside of the eye. In nine of a hundred the stated tolerances
/// move the chief rays off a pupil of 3 mm: a person who sees nothing sets the bench up anew. The
/// first of the row is sample_optics(sigmas, seed). Throws std::invalid_argument where none of a
/// hundred shows anything.
OpticsSample sample_bench(const LaboratorySettings& settings, const OpticsSigmas& sigmas,
                          std::uint64_t seed);

}  // namespace vitreo::sim
