// Run lock: a run's folder belongs to the process that records into it; the system takes the lock
// back when that dies, however it dies.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>

namespace vitreo {

class RunLock {
 public:
  /// Throws std::runtime_error naming the folder when another process (or another part of this one)
  /// records there.
  explicit RunLock(const std::filesystem::path& folder);
  ~RunLock();
  RunLock(const RunLock&) = delete;
  RunLock& operator=(const RunLock&) = delete;
  void release() noexcept;
  /// Whether a process records into the folder now.
  static bool is_held(const std::filesystem::path& folder);

 private:
  std::filesystem::path file_;
  int descriptor_ = -1;
};

}  // namespace vitreo
