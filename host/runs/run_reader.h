// Run reader: a run's folder read back, of a run that is over, goes on, or was killed. What is
// broken or foreign is an error that says so, never a crash.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/record/run_data.h"

#include <opencv2/core/mat.hpp>

#include <filesystem>
#include <stdexcept>
#include <string>
#include <vector>

namespace vitreo {

/// A folder that is no run, or whose record is broken. The text names the file.
class RecordError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// RUN of the command line: a folder, its name or the beginning of one below `parent`, or "last".
/// Throws RecordError that says which runs a beginning could mean.
std::filesystem::path find_run(const std::string& word, const std::filesystem::path& parent);

/// The run folders below `parent`, oldest first; none where there is no such folder.
std::vector<std::filesystem::path> run_folders(const std::filesystem::path& parent);

/// Head of a record, for lists: quick, without samples and pictures.
struct RunHead {
  std::string folder;
  std::string time;
  std::string protocol;
  std::string title;
  std::string operator_name;
  std::string seed;
  std::string state;  // the outcome, or "running", "lost" (killed, not recovered yet), "unreadable"
  std::string reason;          // of the end, or why it cannot be read
  double experiment_time = 0;  // s
};
/// Never throws for what is in the folder: the state says it.
RunHead read_head(const std::filesystem::path& folder);

/// The pixels of one recorded frame; color as BGR. Throws std::runtime_error naming the file when
/// they are not there.
cv::Mat read_frame(const RunData& data, const FrameRow& row);

/// All of it. Samples of a run that goes on are those committed by now. Throws RecordError.
RunData read_run(const std::filesystem::path& folder);

}  // namespace vitreo
