// Sweep drawings: maps, lines and clouds of one result over what was varied.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/trials/sweep_groups.h"

#include <string>
#include <vector>

namespace vitreo {

/// <figure> elements. `whole`: a map where two parameters were varied, and lines along each; else
/// one small drawing. Empty where the result is no number anywhere.
std::string sweep_figures(const SweepTable& table, const std::vector<VariedColumn>& varied,
                          std::size_t result, bool whole);

}  // namespace vitreo
