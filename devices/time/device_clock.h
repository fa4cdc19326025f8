// Device clock: an instrument's own clock on the host's, from the arrivals of what it has stamped
// and from direct comparisons.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/time/clock.h"

#include <deque>
#include <optional>
#include <vector>

namespace vitreo {

/// Both kinds of evidence may be mixed. A device's time that steps back (it was restarted) begins
/// anew. Drifts beyond 200 ppm are no crystal's and are not followed.
class DeviceClock {
 public:
  /// What the device stamped with `device` came at `host`: by a delay that is never negative and
  /// of which only the least is constant.
  void arrived(Time device, Time host);
  /// The device read `device` at some moment between `before` and `after` of the host.
  void compared(Time device, Time before, Time after);
  /// The host's time at the device's `device`. By comparisons, where there are any; else later than
  /// it by the least delay of an arrival, which only a data sheet or a lamp can tell. Nothing
  /// before the first evidence.
  std::optional<Time> host_of(Time device) const;
  /// Whether there are comparisons that still count.
  bool is_compared() const { return !comparisons_.empty(); }

 private:
  struct Point {
    double device = 0;  // s, since origin_
    double offset = 0;  // s, host's minus device's time, less that of the first evidence
    double within = 0;  // s, half the width of a comparison
  };
  struct Line {
    double device = 0;  // s, where it was evaluated
    double offset = 0;  // s
    double slope = 0;   // s/s
  };
  Point point(Time device, Time host);
  void forget(double before);
  static Line below(const std::vector<Point>& points);
  static Line through(const std::deque<Point>& points);

  std::optional<Time> origin_;  // of the device's time, at the first evidence
  Time offset_{};               // host's minus device's time there
  Time last_{};                 // of the device's, as it came last
  std::deque<Point> earliest_;  // of each quarter of a second of arrivals that of the least delay
  std::deque<Point> comparisons_;
  Line line_;
};

}  // namespace vitreo
