// SPDX-License-Identifier: Apache-2.0
#include "devices/sim/defocus_wave.h"

#include <cmath>

namespace vitreo::sim {

// Simpson's rule in rho; the integrand turns by at most u + v, of which each step takes a third of
// a radian.
double defocused_intensity(double u, double v) {
  const int steps = 2 * static_cast<int>(std::ceil(8 + 1.5 * (std::abs(u) + std::abs(v))));
  double real = 0;
  double imaginary = 0;
  for (int i = 0; i <= steps; ++i) {
    const double rho = static_cast<double>(i) / steps;
    const double weight = (i == 0 || i == steps ? 1 : i % 2 == 1 ? 4 : 2) * rho * ::j0(v * rho);
    real += weight * std::cos(u * rho * rho / 2);
    imaginary += weight * std::sin(u * rho * rho / 2);
  }
  const double scale = 2.0 / (3 * steps);
  return scale * scale * (real * real + imaginary * imaginary);
}

}  // namespace vitreo::sim
