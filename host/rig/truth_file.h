// Truth file of an emulated laboratory: where the robot really is and what really flows, as CSV,
// for those who judge a run; the run itself never sees it.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/rig/emulate.h"

#include <filesystem>
#include <memory>

namespace vitreo {

/// A row every 20 ms from its construction on: UTC, the machine's monotonic clock (s), the robot's
/// position (m, world) and axis, whether it is beyond the field's calibration, and of each coil the
/// set-point (A), the current that flows (A) and its temperature (K). Cells of a robot that is not
/// there are empty.
class TruthFile {
 public:
  /// Throws std::runtime_error naming the file when it is there already, or cannot be made.
  /// `emulation` must outlive it.
  TruthFile(const std::filesystem::path& file, Emulation& emulation);
  /// Ends it without the half second of finish().
  ~TruthFile();
  TruthFile(const TruthFile&) = delete;
  TruthFile& operator=(const TruthFile&) = delete;

  /// Half a second more, in which coils that were zeroed have lost their current; then the file is
  /// complete. Throws std::runtime_error when a row could not be written.
  void finish();

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace vitreo
