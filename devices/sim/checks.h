// The two questions that every setting of the simulated laboratory is asked.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <stdexcept>
#include <string>

namespace vitreo::sim {

inline void require_positive(double value, const char* name) {
  if (!(value > 0) || !std::isfinite(value))
    throw std::invalid_argument(std::string(name) + " must be above zero");
}

inline void require_not_negative(double value, const char* name) {
  if (!(value >= 0) || !std::isfinite(value))
    throw std::invalid_argument(std::string(name) + " must not be negative");
}

}  // namespace vitreo::sim
