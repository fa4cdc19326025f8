// Turn sharing: what a clock offers to a task that computes for long beside the others.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/time/clock.h"

namespace vitreo {

/// Of both clocks (devices/time/clock.h). A task that is alone computes with nothing in hand that
/// another task touches, such as a script's plain statements. At the pace of the wall clock the
/// others may have their turn beside it: under wall_clock() at once, under
/// virtual_clock(Pace::real_time) after some tens of milliseconds, so that what computes for less
/// is the same in every run. Without a pace time stands still, and nothing happens.
class TurnSharing {
 public:
  virtual ~TurnSharing() = default;
  /// The calling task is alone from here on: it calls nothing of the clock but now() and
  /// end_alone(). False, and nothing changes, where it or another task is alone already, or the
  /// clock has no pace.
  virtual bool begin_alone() = 0;
  /// Returns with the turn in hand. False, and nothing changes, where the calling task is not
  /// alone.
  virtual bool end_alone() = 0;
  /// Wall time since begin_alone(); zero where no task is alone. Any thread.
  virtual Time alone_for() const noexcept = 0;
};

/// Of a clock of ours; null for any other.
inline TurnSharing* turn_sharing(Clock& clock) { return dynamic_cast<TurnSharing*>(&clock); }

}  // namespace vitreo
