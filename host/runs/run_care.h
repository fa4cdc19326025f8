// Verification and recovery of closed runs.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/record/run_data.h"

#include <filesystem>
#include <string>
#include <vector>

namespace vitreo {

struct RunCheck {
  std::vector<std::string> problems;  // one line each; none: the record is whole
  // Checked.
  std::size_t files = 0;
  std::size_t frames = 0;
  std::size_t samples = 0;
};

/// Hashes, the database's own integrity, sample counts against the end record, order of time, and
/// every frame's CRC. Never throws for what is in the folder.
RunCheck verify_run(const std::filesystem::path& folder);

struct Recovery {
  /// There was an end record already: nothing was done but what was left of its files.
  bool was_closed = false;
  std::size_t frames_named = 0;  // frames that were in the stacks without a row
};

/// Gives a run whose program died an end record "lost", mends its frame stacks, makes its report
/// and its manifest. Idempotent. Throws RecordError; std::runtime_error when the run is being
/// recorded.
Recovery recover_run(const std::filesystem::path& folder);

/// Makes report.html and summary.json anew from what is recorded, and the manifest with them.
/// Throws RecordError.
void report_run(const std::filesystem::path& folder);

}  // namespace vitreo
