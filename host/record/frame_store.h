// Frame store: an NDTiff stack a camera, and the rows that name the frames once their pixels are on
// the disk.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/roles/camera.h"
#include "host/files/ndtiff.h"
#include "host/record/record_file.h"
#include "host/record/run_data.h"

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <mutex>
#include <vector>

namespace vitreo {

/// Belongs to the recorder's thread, but for rows(). Errors of the disk throw std::runtime_error
/// naming the file.
class FrameStore {
 public:
  FrameStore(std::filesystem::path folder, std::uint64_t largest_stack);
  void add(const RecordedCameraInfo& info);
  /// Pixels and index entry are written when this returns; the row comes with write_rows().
  void write(std::size_t camera, const Frame& frame, const MissingFrames& missing);
  /// Once a second, or `now`: waits until the pixels are on the disk, then commits the rows that
  /// name them.
  void write_rows(RecordFile& file, bool now);
  /// Of the frames that are written; from any thread, also while the recorder's writes.
  std::vector<FrameRow> rows() const;
  std::uint64_t bytes() const { return bytes_; }

 private:
  struct Stack {
    RecordedCameraInfo info;
    std::unique_ptr<NdtiffWriter> writer;  // made with the first frame
    std::int64_t count = 0;
  };
  void open(Stack& stack, const Frame& frame);

  std::filesystem::path folder_;
  std::uint64_t largest_stack_;  // bytes
  std::uint64_t bytes_ = 0;
  std::vector<Stack> stacks_;
  mutable std::mutex mutex_;
  std::vector<FrameRow> rows_;  // changed by the recorder's thread alone, with the lock
  std::size_t named_ = 0;       // rows that are in run.sqlite
  std::chrono::steady_clock::time_point waiting_since_;
};

}  // namespace vitreo
