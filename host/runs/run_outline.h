// Outline of a run: what was asked and what came out, without its samples, frames, events and
// links.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/record/run_data.h"

#include <filesystem>

namespace vitreo {

/// As quick for a run of a night as for one of a second; by the reader of whole runs
/// (host/runs/run_reader.cpp). Throws RecordError.
RunData read_outline(const std::filesystem::path& folder);

}  // namespace vitreo
