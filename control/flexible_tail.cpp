// SPDX-License-Identifier: Apache-2.0
#include "control/flexible_tail.h"

#include "control/constants.h"
#include "control/preconditions.h"

#include <cmath>

namespace vitreo::control {

void FlexibleTail::check() const {
  require(positive(length), "tail length: must be above 0 m");
  require(positive(radius) && radius < length / 10,
          "tail radius: must be above 0 m and below a tenth of the length (it is slender)");
  require(positive(modulus), "tail modulus: must be above 0 Pa");
  require(positive(head_radius), "tail head_radius: must be above 0 m");
}

FlexibleTail FlexibleTail::scaled(double factor) const {
  FlexibleTail other = *this;
  for (double* size : {&other.length, &other.radius, &other.head_radius}) *size *= factor;
  return other;
}

double FlexibleTail::stiffness() const { return modulus * kPi / 4 * std::pow(radius, 4); }

namespace {

// Of a slender spheroid of length L and radius r (Perrin's in the limit), per length and viscosity,
//   tangential = 2 pi / (ln(L / r) - 1/2),   normal = 4 pi / (ln(L / r) + 1/2).
double logarithm(const FlexibleTail& tail) { return std::log(tail.length / tail.radius); }
double normal_of(const FlexibleTail& tail) { return 4 * kPi / (logarithm(tail) + 0.5); }

}  // namespace

// The drags' center: the head's 6 pi a at 0 and the filament's, whose middle is a + L / 2 behind.
double FlexibleTail::head_lever() const {
  const double filament = normal_of(*this) * length;
  return filament * (head_radius + length / 2) / (filament + 6 * kPi * head_radius);
}

double FlexibleTail::reach() const { return length + head_radius - head_lever(); }

// About the center of reaction: b the head's lever, c that of the filament's middle.
TailDrag tail_drag(const FlexibleTail& tail, double viscosity) {
  tail.check();
  require(positive(viscosity), "viscosity: must be above 0 Pa s");
  const double L = tail.length, a = tail.head_radius;
  const double b = tail.head_lever(), c = b - a - L / 2;
  TailDrag drag;
  drag.tangential = 2 * kPi * viscosity / (logarithm(tail) - 0.5);
  drag.normal = viscosity * normal_of(tail);
  drag.head = 6 * kPi * viscosity * a;
  drag.head_spin = 8 * kPi * viscosity * a * a * a;
  drag.along = drag.head + drag.tangential * L;
  drag.across = drag.head + drag.normal * L;
  drag.turning = drag.head * b * b + drag.head_spin + drag.normal * L * (L * L / 12 + c * c);
  return drag;
}

double sperm_number(const FlexibleTail& tail, double viscosity, double frequency) {
  require(not_negative(frequency), "frequency: must be at least 0 Hz");
  const double normal = tail_drag(tail, viscosity).normal;
  return tail.length * std::pow(2 * kPi * frequency * normal / tail.stiffness(), 0.25);
}

}  // namespace vitreo::control
