// Preconditions of the simulated laboratory's settings and arguments.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <stdexcept>
#include <string>

namespace vitreo::sim {

/// Throws std::invalid_argument with `what`, which names the argument, unless `good`.
inline void require(bool good, const char* what) {
  if (!good) throw std::invalid_argument(what);
}

/// Throws std::invalid_argument naming a parameter that is not finite and above 0.
inline void require_positive(double value, const char* name) {
  if (!(value > 0) || !std::isfinite(value))
    throw std::invalid_argument(std::string(name) + " must be above zero");
}

/// Throws std::invalid_argument naming a parameter that is not finite and at least 0.
inline void require_not_negative(double value, const char* name) {
  if (!(value >= 0) || !std::isfinite(value))
    throw std::invalid_argument(std::string(name) + " must not be negative");
}

}  // namespace vitreo::sim
