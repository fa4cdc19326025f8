// Preconditions of the control library's settings and arguments. For its sources only.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <stdexcept>

namespace vitreo::control {

/// Throws std::invalid_argument with `what`, which names the argument, unless `good`.
inline void require(bool good, const char* what) {
  if (!good) throw std::invalid_argument(what);
}

/// Finite and above 0; false for NaN.
inline bool positive(double value) { return std::isfinite(value) && value > 0; }
/// Finite and at least 0; false for NaN.
inline bool not_negative(double value) { return std::isfinite(value) && value >= 0; }

}  // namespace vitreo::control
