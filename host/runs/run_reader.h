// Run reader: a run's folder read back, of a run that is over, goes on, or was killed. What is
// broken or foreign is an error that says so, never a crash.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/record/run_data.h"
#include "host/runs/open_record.h"
#include "host/runs/run_summary.h"

#include <opencv2/core/mat.hpp>

#include <filesystem>
#include <stdexcept>
#include <string>
#include <vector>

namespace vitreo {

/// RUN of the command line: a folder, its name or the beginning of one below `parent`, or "last".
/// Throws RecordError that says which runs a beginning could mean.
std::filesystem::path find_run(const std::string& word, const std::filesystem::path& parent);

/// The run folders below `parent`, oldest first; none where there is no such folder.
std::vector<std::filesystem::path> run_folders(const std::filesystem::path& parent);

/// The pixels of one recorded frame; color as BGR. Throws std::runtime_error naming the file when
/// they are not there.
cv::Mat read_frame(const RunData& data, const FrameRow& row);

/// All of it. Samples of a run that goes on are those committed by now. Throws RecordError.
RunData read_run(const std::filesystem::path& folder);

}  // namespace vitreo
