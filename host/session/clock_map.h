// Clock map: offset and drift of an instrument's own clock against the host's, from pairs of times
// of which the host's are late by a jitter that is never negative.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/time/clock.h"

#include <deque>
#include <optional>

namespace vitreo {

struct ClockOffset {
  double offset = 0;  // s to be added to the instrument's time to have the host's, at the last pair
  double drift = 0;   // s/s by which the offset grows
};

/// Of each second the pair with the smallest delay counts; a line through those of the last two
/// minutes (least squares) gives the drift. An instrument's clock that jumps back begins anew.
class ClockMap {
 public:
  void add(Time device, Time host);
  /// Nothing before the first whole second.
  std::optional<ClockOffset> now() const;

 private:
  struct Pair {
    double device;  // s, of the instrument's clock
    double offset;  // s, host's minus instrument's time, jitter included
  };
  std::deque<Pair> best_;  // one a second
  std::optional<Pair> present_;
  double second_ = 0;  // the device's, in which `present_` is
};

}  // namespace vitreo
