// Disk watch: how long the disk will last at the rate at which a run writes, and when that is too
// short.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <deque>
#include <filesystem>
#include <functional>
#include <string>
#include <utility>

namespace vitreo {

struct DiskLimits {
  // s of recording that are left at the present rate.
  double warn_seconds = 600;
  double stop_seconds = 120;
  std::uint64_t stop_bytes = 256000000;  // where nothing but samples and pictures is recorded
  std::uint64_t stop_bytes_with_frames = 1000000000;
  // Kept by a file that is removed when the end record needs the room.
  std::uint64_t reserve_bytes = 64000000;
  /// Bytes that are free at a path; the tests put in another. The default asks the file system.
  std::function<std::uint64_t(const std::filesystem::path&)> free_bytes;
};

/// Bytes that are free at `path`; the most there can be where the file system cannot be asked.
std::uint64_t free_bytes(const std::filesystem::path& path);

/// `space` bytes in a display unit: "1.2 GB".
std::string size_text(std::uint64_t space);

class DiskWatch {
 public:
  using Instant = std::chrono::steady_clock::time_point;
  DiskWatch(std::filesystem::path folder, DiskLimits limits);
  /// Before anything is written: throws std::runtime_error naming the folder when less is left than
  /// a run must not begin with.
  void check_start() const;
  /// The reserve, as far as the file system can set room aside; where it cannot there is none.
  void make_reserve();
  void give_up_reserve() noexcept;
  struct Verdict {
    // Empty: none; the warning comes once.
    std::string warning;
    std::string stop;
  };
  /// `written`: bytes of this run so far.
  Verdict look(std::uint64_t written, bool frames, Instant now);
  std::uint64_t free() const;
  const DiskLimits& limits() const { return limits_; }

 private:
  double rate(std::uint64_t written, Instant now);

  std::filesystem::path folder_;
  DiskLimits limits_;
  std::deque<std::pair<Instant, std::uint64_t>> history_;
  bool warned_ = false;
};

}  // namespace vitreo
