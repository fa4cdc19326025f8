// SPDX-License-Identifier: Apache-2.0
#include "control/rolling.h"

#include "control/preconditions.h"

#include <algorithm>
#include <cmath>

namespace vitreo::control {

// The force 6 pi eta R (F_t U + F_r w R) on a sphere that goes and turns vanishes:
// U / (w R) = F_r / -F_t. With d = gap / R within 0.1,
//   F_r = -(2/15) ln d - 0.2526,   F_t = (8/15) ln d - 0.9588;
// with x = R / h beyond,
//   F_r = x^4 (1 - 3 x / 8) / 8,   F_t = -1 / (1 - 9 x/16 + x^3/8 - 45 x^4/256 - x^5/16).
double fluid_rolling(double radius, double distance) {
  require(positive(radius) && positive(distance), "radius and distance: must be above 0 m");
  constexpr double kRough = 1e-3;
  constexpr double kNear = 0.1;
  const double gap = std::max(distance / radius - 1, kRough);
  if (gap < kNear) {
    const double logarithm = std::log(gap);
    return (2. / 15 * logarithm + 0.2526) / (8. / 15 * logarithm - 0.9588);
  }
  const double x = 1 / (1 + gap);
  const double x3 = x * x * x;
  const double slowed = 1 - 9. / 16 * x + x3 / 8 - 45. / 256 * x3 * x - x3 * x * x / 16;
  return x3 * x * (1 - 3. / 8 * x) / 8 * slowed;
}

}  // namespace vitreo::control
