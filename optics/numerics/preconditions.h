// Preconditions: checks of arguments that throw std::invalid_argument.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <stdexcept>
#include <string>

namespace vitreo::optics::detail {

/// Throws std::invalid_argument with `why`, which begins with the argument's name, unless `good`.
/// Conditions are written so that a NaN fails them.
inline void require(bool good, const char* why) {
  if (!good) throw std::invalid_argument(why);
}

// Of one number, by its name. Infinities are refused too.
inline void require_finite(double value, const char* name) {
  if (!std::isfinite(value)) throw std::invalid_argument(std::string(name) + ": must be finite");
}
inline void require_positive(double value, const char* name) {
  if (!(std::isfinite(value) && value > 0))
    throw std::invalid_argument(std::string(name) + ": must be positive");
}
inline void require_not_negative(double value, const char* name) {
  if (!(std::isfinite(value) && value >= 0))
    throw std::invalid_argument(std::string(name) + ": must not be negative");
}
inline void require_at_least(int value, int least, const char* name) {
  if (value < least) {
    throw std::invalid_argument(std::string(name) + ": must be at least " + std::to_string(least));
  }
}

}  // namespace vitreo::optics::detail
