// SPDX-License-Identifier: Apache-2.0
#include "control/helix.h"

#include "control/constants.h"
#include "control/preconditions.h"

#include <cmath>

namespace vitreo::control {

void Helix::check() const {
  require(positive(radius), "helix radius: must be above 0 m");
  require(positive(pitch), "helix pitch: must be above 0 m");
  require(positive(turns) && turns == std::floor(turns), "helix turns: must be whole, 1 or more");
  require(positive(filament_radius) && filament_radius < pitch / 4,
          "helix filament_radius: must be above 0 m and below a quarter of the pitch");
  require(not_negative(head_radius), "helix head_radius: must be at least 0 m");
}

Helix Helix::scaled(double factor) const {
  Helix other = *this;
  for (double* length : {&other.radius, &other.pitch, &other.filament_radius, &other.head_radius})
    *length *= factor;
  return other;
}

// The filament's drag per length is k_t (u.t) t + k_n (u - (u.t) t), u its velocity, t its tangent,
//   k_t = 2 pi eta / (ln(2 P / a) - 1/2),   k_n = 4 pi eta / (ln(2 P / a) + 1/2)
// (Gray & Hancock 1955), P the pitch, a the filament's radius. With the pitch angle th,
// tan th = P / (2 pi R), the tangent is (cos th) e_phi + (sin th) e_z, and u = v e_z + w R e_phi
// gives, integrated over the filament's length L,
//   along = L (k_t sin^2 + k_n cos^2), coupling = -L R (k_n - k_t) sin cos,
//   spin = L R^2 (k_t cos^2 + k_n sin^2).
// Across the axis the mean over the roll: of t_x^2 it is cos^2 / 2; turning about x, u =
// w (y e_z - z e_y), with the mean of z^2 being l^2 / 12 and that of y^2 R^2 / 2, and of (u.t) t_x
// w R sin cos / 2.
HelixResistance helix_resistance(const Helix& helix, double viscosity) {
  helix.check();
  require(positive(viscosity), "viscosity: must be above 0 Pa s");
  const double logarithm = std::log(2 * helix.pitch / helix.filament_radius);
  const double tangential = 2 * kPi * viscosity / (logarithm - 0.5);
  const double normal = 4 * kPi * viscosity / (logarithm + 0.5);
  const double difference = normal - tangential;
  const double R = helix.radius;
  const double angle = std::atan2(helix.pitch, 2 * kPi * R);
  const double sine = std::sin(angle), cosine = std::cos(angle);
  const double length = helix.length() / sine;                // of the filament
  const double lever = helix.length() * helix.length() / 12;  // m^2, mean square along the axis
  const double head = helix.head_radius;
  HelixResistance result;
  result.along = length * (normal - difference * sine * sine) + 6 * kPi * viscosity * head;
  result.coupling = (helix.left_handed ? 1 : -1) * length * R * difference * sine * cosine;
  const double head_spin = 8 * kPi * viscosity * head * head * head;
  result.spin = length * R * R * (normal - difference * cosine * cosine) + head_spin;
  result.across = length * (normal - difference * cosine * cosine / 2) + 6 * kPi * viscosity * head;
  result.coupling_across = -result.coupling / 2;
  result.turning = length * (normal * (lever + R * R / 2) -
                             difference * (lever * cosine * cosine + R * R * sine * sine) / 2) +
                   head_spin;
  return result;
}

}  // namespace vitreo::control
