// Latch of a GenICam camera's clock: its time, read on command, between two of the host's.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/instruments/genicam/features.h"
#include "devices/time/clock.h"
#include "devices/time/device_clock.h"

#include <string>

namespace vitreo::genicam {

/// Hz of the counter that a GigE Vision camera stamps with; 0: unknown, or ns.
double tick_frequency(ArvCamera* camera, const Features& features);

class Latch {
 public:
  /// Looks which names the camera has for it: SFNC's, or GigE Vision 1's. Outside the baton.
  Latch(ArvCamera* camera, const Features& features);
  /// Whether the camera has a latch that has answered so far.
  bool usable() const { return !latch_.empty(); }
  /// What it says is of another clock than the frames' stamps.
  void give_up() { latch_.clear(); }
  /// A few exchanges; the one of the shortest round trip counts. Outside the baton. A camera that
  /// does not answer is not asked again: what is wrong with it shows at the next frame.
  void compare(const Clock& clock, DeviceClock& device_clock);

 private:
  const Features& features_;
  std::string latch_;  // the command; empty: none
  std::string value_;  // the feature that holds the latched time
  double tick_ = 1;    // ns
};

}  // namespace vitreo::genicam
