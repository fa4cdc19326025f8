// SPDX-License-Identifier: Apache-2.0
#include "host/interlock.h"

#include "devices/error.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace vitreo {

void InterlockLimits::check() const {
  if (!(current > 0)) throw std::invalid_argument("current limit must be above zero");
  if (!(total_current > 0)) throw std::invalid_argument("total_current limit must be above zero");
}

Interlock::Interlock(CoilAmplifier& amplifier, const InterlockLimits& limits) : amplifier_(amplifier), limits_(limits) {
  limits_.check();
}

double Interlock::current_limit() const { return std::min(limits_.current, amplifier_.current_limit()); }

void Interlock::set_currents(std::span<const double> currents) {
  const auto refuse = [&](const std::string& why) {
    make_safe();
    throw DeviceError(DeviceErrorKind::refused, "coils", why + "; the coils are at zero");
  };
  if (!enabled_) throw DeviceError(DeviceErrorKind::refused, "coils", "the interlock is open; enable it first");
  double total = 0;
  for (std::size_t channel = 0; channel < currents.size(); ++channel) {
    const double magnitude = std::abs(currents[channel]);
    // written so that NaN is refused too
    if (!(magnitude <= current_limit() * (1 + 1e-9)))
      refuse(fmt::format("coil {}: {:.3g} A is beyond the limit of {:.3g} A", channel + 1, currents[channel],
                         current_limit()));
    total += magnitude;
  }
  if (total > limits_.total_current)
    refuse(fmt::format("{:.3g} A in all are beyond the limit of {:.3g} A", total, limits_.total_current));
  amplifier_.set_currents(currents);
}

void Interlock::make_safe() {
  enabled_ = false;
  amplifier_.make_safe();
}

}  // namespace vitreo
