// Remaining time of a way whose part that is behind is told now and then.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <optional>

namespace vitreo {

class RemainingTime {
 public:
  using Instant = std::chrono::steady_clock::time_point;
  /// `fraction` of the way is behind at `now`. Returns s at the pace since the way began; nothing
  /// where too little is behind to tell. It begins with its object, with a fraction of 0, and where
  /// the fraction falls: that is another way, such as the next run's at the prompt.
  std::optional<double> told(double fraction, Instant now = std::chrono::steady_clock::now()) {
    if (fraction == 0 || fraction < last_) {
      begun_ = now;
      from_ = fraction;
    }
    last_ = fraction;
    constexpr double kLeast = 0.01;  // the first percent says little about the rest
    const double gone = fraction - from_;
    if (!(gone > kLeast)) return std::nullopt;
    return std::chrono::duration<double>(now - begun_).count() * (1 - fraction) / gone;
  }

 private:
  Instant begun_ = std::chrono::steady_clock::now();
  double from_ = 0;
  double last_ = 0;
};

}  // namespace vitreo
