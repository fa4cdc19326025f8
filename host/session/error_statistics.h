// Error statistics: deviation of one recorded track from another, in 3-D, lateral and in depth.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/time/clock.h"

#include <cstddef>
#include <string>

namespace vitreo {

class Recorder;

/// Of |error|, in m: the 3-D distance, its lateral part (x and y) and its depth part (z).
struct ErrorStatistics {
  std::size_t count = 0;
  double rms = 0;
  double mean = 0;
  double max = 0;
  double lateral_rms = 0;
  double lateral_mean = 0;
  double lateral_max = 0;
  double lateral_std = 0;  // of a sample (n - 1)
  double depth_rms = 0;
  double depth_mean = 0;
  double depth_max = 0;
  double depth_std = 0;  // of a sample (n - 1)
};

/// Statistics of one recorded stream against another, both holding x, y, z in m, over the times of
/// the first in [from, to] at which the other has a row. Where they share no moment at all, as of
/// two cameras that run freely, the other is interpolated between rows at most 150 ms apart. Where
/// one has no y (a side view), y is not compared; rows that are not finite (the robot was lost) are
/// left out. `stream` and `reference` such as "truth" and "servo", each with the prefix of its
/// three channels' names: "" for x, y, z or "target_" for target_x ... Throws std::invalid_argument
/// naming what is missing.
ErrorStatistics error_statistics(const Recorder& recorder, const std::string& stream,
                                 const std::string& prefix, const std::string& reference,
                                 const std::string& reference_prefix, Time from, Time to);

}  // namespace vitreo
