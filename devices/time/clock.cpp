// SPDX-License-Identifier: Apache-2.0
#include "devices/time/clock.h"

#include <chrono>
#include <cmath>
#include <stdexcept>

namespace vitreo {

Time from_seconds(double seconds) {
  const double nanoseconds = seconds * 1e9;
  // The bound is the largest double below 2^63; written so that a NaN fails too.
  if (!(std::abs(nanoseconds) <= 9223372036854774784.0))
    throw std::invalid_argument("seconds: " + std::to_string(seconds) + " is not a time that fits");
  return Time(std::llround(nanoseconds));
}

double wall_seconds() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

}  // namespace vitreo
