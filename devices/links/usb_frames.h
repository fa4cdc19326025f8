// Frames of a USB: when a transfer is over that is asked for now.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/time/clock.h"

#include <algorithm>

namespace vitreo {

/// A full-speed bus begins one frame a millisecond, and an interrupt endpoint moves at most one
/// report in each (USB 2.0, 5.7.4 and 8.4.3); the device's bInterval may ask for fewer.
constexpr Time kUsbFrame = std::chrono::milliseconds(1);

/// One endpoint: its transfers end on a grid of `interval`, one after another.
class UsbFrames {
 public:
  /// Zero: transfers take no time.
  explicit UsbFrames(Time interval = kUsbFrame) : interval_(interval) {}
  /// The end of a transfer that is asked for at `now`: with the next frame in which none of those
  /// that were asked for before is.
  Time next(Time now) {
    if (interval_ <= Time::zero()) return now;
    last_ = std::max((now / interval_ + 1) * interval_, later(last_, interval_));
    return last_;
  }

 private:
  Time interval_;
  Time last_{};
};

}  // namespace vitreo
