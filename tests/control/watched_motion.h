// Motions that a motion watch is shown, a turn each sixteenth of a second.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/motion_watch.h"

#include <functional>

namespace vitreo::control {

using MakeMotion = std::function<void(WatchedMotion&)>;

constexpr double kTurn = 1 / 16.0;  // s, exact in binary: so are the windows' edges

/// What is said at the time `until`, s, of motions that `make` makes of their times.
inline MotionWatch watched(double until, const MakeMotion& make) {
  MotionWatch watch;
  for (int k = 0; k * kTurn <= until; ++k) {
    WatchedMotion now;
    now.time = k * kTurn;
    make(now);
    watch.add(now);
  }
  return watch;
}

}  // namespace vitreo::control
