// SPDX-License-Identifier: Apache-2.0
#include "devices/sim/stage_play.h"

#include "devices/sim/checks.h"

#include <algorithm>

namespace vitreo::sim {

void StagePlaySettings::check() const {
  require_not_negative(backlash, "stage.backlash");
  require_not_negative(noise, "stage.noise");
}

StagePlay::StagePlay(const StagePlaySettings& settings, std::uint64_t seed)
    : settings_(settings), random_(seed) {
  settings.check();
}

double StagePlay::carried(double motor) {
  if (settings_.backlash == 0 && settings_.noise == 0) return motor;
  if (motor_ == motor) return middle_ + beside_;
  const double half = settings_.backlash / 2;
  // Before its first motion it stands where the motor is.
  middle_ = motor_ ? std::clamp(middle_, motor - half, motor + half) : motor;
  motor_ = motor;
  beside_ = settings_.noise * std::normal_distribution<double>()(random_);
  return middle_ + beside_;
}

}  // namespace vitreo::sim
