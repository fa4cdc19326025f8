// Upper limits of the chi square distribution.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/numerics/preconditions.h"

#include <cmath>

namespace vitreo::optics::detail {

/// z that a unit normal number exceeds with a probability of at most 0.5: Abramowitz and Stegun
/// 26.2.23, to 4.5e-4.
inline double normal_limit(double probability) {
  require(probability > 0 && probability <= 0.5, "probability: must be above 0 and at most 0.5");
  const double t = std::sqrt(-2 * std::log(probability));
  return t - (2.515517 + t * (0.802853 + t * 0.010328)) /
                 (1 + t * (1.432788 + t * (0.189269 + t * 0.001308)));
}

/// What chi square of so many degrees of freedom exceeds with this probability, by Wilson and
/// Hilferty's cube (1931): to 1 % at two degrees, 0.1 % at a hundred.
inline double chi_square_limit(int degrees, double probability) {
  require(degrees > 0, "degrees: must be above 0");
  const double width = 2.0 / (9.0 * degrees);
  const double root = 1 - width + normal_limit(probability) * std::sqrt(width);
  return degrees * root * root * root;
}

}  // namespace vitreo::optics::detail
