// Retriggerable one-shot with a relay behind it, at the far end of a heartbeat line.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/time/clock.h"

#include <algorithm>
#include <deque>

namespace vitreo::sim {

/// Each rising edge switches the relay on for `width` from then on; a level does nothing. The
/// function table of a 74HC123 whose input B is the line. Times do not run backwards within
/// input(), nor within on(), which may lag behind.
class OneShot {
 public:
  explicit OneShot(Time width) : width_(width) {}
  void input(bool high, Time now) {
    const bool edge = high && !high_;
    high_ = high;
    if (!edge) return;
    const Time until = later(now, width_);
    if (!pulses_.empty() && now <= pulses_.back().end)
      pulses_.back().end = std::max(pulses_.back().end, until);
    else
      pulses_.push_back({now, until});
  }
  bool on(Time now) {
    while (!pulses_.empty() && pulses_.front().end <= now) pulses_.pop_front();
    return !pulses_.empty() && pulses_.front().begin <= now;
  }

 private:
  struct Pulse {
    Time begin;
    Time end;
  };
  Time width_;
  bool high_ = false;
  std::deque<Pulse> pulses_;
};

}  // namespace vitreo::sim
