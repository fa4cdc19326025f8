// Polling of a descriptor that must not block: the task that waits holds the clock's baton.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/time/clock.h"

#include <algorithm>

namespace vitreo {

/// Waits between two polls at doubling intervals: 100 us at first, for an answer that is nearly
/// there, up to 4 ms, four bytes at 9600 baud, so that a long silence costs little of a processor.
class Polling {
 public:
  Polling(Clock& clock, Time timeout) : clock_(clock), deadline_(later(clock.now(), timeout)) {}
  /// Sleeps until the next poll; false, at once, when the time is over. Throws Stopped.
  bool again() {
    if (clock_.now() >= deadline_) return false;
    clock_.sleep_for(std::min(slice_, deadline_ - clock_.now()));
    slice_ = std::min(2 * slice_, Time(std::chrono::milliseconds(4)));
    return true;
  }

 private:
  Clock& clock_;
  const Time deadline_;
  Time slice_ = std::chrono::microseconds(100);
};

}  // namespace vitreo
