// Reader of recorded videos, frame by frame.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <opencv2/core/mat.hpp>

#include <filesystem>
#include <memory>

namespace vitreo {

class VideoFile {
 public:
  /// Throws std::invalid_argument naming the file when there is none, or when it is no video that
  /// can be read.
  explicit VideoFile(const std::filesystem::path& file);
  ~VideoFile();
  VideoFile(const VideoFile&) = delete;
  VideoFile& operator=(const VideoFile&) = delete;
  /// The next frame, CV_8UC3 BGR and the caller's own; empty at the end.
  cv::Mat read();
  int count() const;  ///< frames, as the file claims; 0 when it does not say

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace vitreo
