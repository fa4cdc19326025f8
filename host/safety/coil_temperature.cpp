// SPDX-License-Identifier: Apache-2.0
#include "host/safety/coil_temperature.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace vitreo {

// Each test is negated, so that NaN is refused as well. Divisors must be above zero: heat capacity
// and thermal resistance make the time constant.
void CoilHeat::check() const {
  if (!(resistance >= 0)) throw std::invalid_argument("coil resistance must not be negative");
  if (!(temperature_coefficient >= 0))
    throw std::invalid_argument("coil temperature_coefficient must not be negative");
  if (!(heat_capacity > 0)) throw std::invalid_argument("coil heat_capacity must be above zero");
  if (!(thermal_resistance > 0))
    throw std::invalid_argument("coil thermal_resistance must be above zero");
  if (!(ambient > 0)) throw std::invalid_argument("ambient temperature must be above zero kelvin");
  if (!(limit > ambient))
    throw std::invalid_argument("coil temperature limit must be above ambient");
}

CoilTemperature::CoilTemperature(const CoilHeat& heat, int coils)
    : heat_(heat), temperatures_(static_cast<std::size_t>(coils), heat.ambient) {
  heat_.check();
}

// C dT/dt = R(T) I^2 - (T - T_ambient) / R_th with R(T) = R0 (1 + alpha (T - T_ambient)) held over
// a step has the exact solution T_end + (T - T_end) exp(-dt / (C R_th)), T_end = T_ambient + R I^2
// R_th.
void CoilTemperature::advance(double seconds, std::span<const double> currents) {
  // s. The time constant C R_th is 385 s by default, so that R changes little within a step.
  constexpr double kStep = 1;
  for (double left = seconds; left > 0; left -= kStep) {
    const double keep =
        std::exp(-std::min(left, kStep) / (heat_.heat_capacity * heat_.thermal_resistance));
    for (std::size_t i = 0; i < temperatures_.size(); ++i) {
      const double resistance = heat_.resistance * (1 + heat_.temperature_coefficient *
                                                            (temperatures_[i] - heat_.ambient));
      const double final =
          heat_.ambient + resistance * currents[i] * currents[i] * heat_.thermal_resistance;
      temperatures_[i] = final + (temperatures_[i] - final) * keep;
    }
  }
}

// The limit is one for all coils, so the hottest decides. There is at least one coil.
double CoilTemperature::hottest() const {
  return *std::max_element(temperatures_.begin(), temperatures_.end());
}

}  // namespace vitreo
