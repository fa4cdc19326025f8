// SPDX-License-Identifier: Apache-2.0
#include "devices/sim/coil_bank.h"

#include "devices/sim/checks.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace vitreo::sim {
namespace {

constexpr double kCoilStep = 1e-3;  // s

}  // namespace

void CoilBankSettings::check(int coils) const {
  require_positive(bandwidth, "coil_bandwidth");
  require_not_negative(delay, "coil_delay");
  require_not_negative(noise, "current_noise");
  require_positive(resistance, "coil_resistance");
  require_not_negative(temperature_coefficient, "coil_temperature_coefficient");
  require_positive(heat_capacity, "coil_heat_capacity");
  require_positive(thermal_resistance, "coil_thermal_resistance");
  require_positive(ambient, "ambient");
  require_positive(supply_voltage, "supply_voltage");
  require(
      std::isfinite(gain_temperature_coefficient) && std::abs(gain_temperature_coefficient) < 5e-3,
      "heat.gain_temperature_coefficient must be within 0.005 1/K");
  require_not_negative(saturation, "core.saturation");
  require_not_negative(remanence, "core.remanence");
  require(reversal_slope >= 0 && reversal_slope <= 1, "core.reversal_slope must be in [0, 1]");
  require_not_negative(one_shot, "one_shot");
  for (const int coil : dead)
    if (coil < 1 || coil > coils)
      throw std::invalid_argument("dead_coils: there is no coil " + std::to_string(coil) +
                                  ", only 1 to " + std::to_string(coils));
}

// The current decays towards the set-point as e^(-2 pi f t), exactly so from step to step.
CoilBank::CoilBank(const CoilBankSettings& settings, int coils)
    : settings_(settings), keep_(std::exp(-2 * M_PI * settings.bandwidth * kCoilStep)) {
  settings_.check(coils);
  if (settings_.one_shot > 0) relay_.emplace(from_seconds(settings_.one_shot));
  target_ = currents_ = lagging_ = control::Currents::Zero(coils);
  temperatures_ = control::Currents::Constant(coils, settings_.ambient);
  response_ = control::Currents::Ones(coils);
}

// A queue, because the delay may be longer than the time between two set-points. A dead coil is
// told zero, so it stays cold as well.
void CoilBank::command(Time time, const control::Currents& set_points) {
  require(set_points.size() == target_.size(), "commands: one for each coil is wanted");
  require(set_points.allFinite(), "commands: not finite");
  const Time acts_from = time + from_seconds(settings_.delay);
  require(commands_.empty() || acts_from >= commands_.back().acts_from, "time runs backwards");
  commands_.push_back({acts_from, set_points});
  for (const int coil : settings_.dead) commands_.back().currents[coil - 1] = 0;
}

void CoilBank::set_response(int coil, double part) {
  require(coil >= 1 && coil <= response_.size(), "response: there is no such coil");
  require(std::isfinite(part), "response: not finite");
  response_[coil - 1] = part;
}

void CoilBank::set_line(Time time, bool high) {
  if (relay_) relay_->input(high, time);
}

// Electrical and thermal state over one step. Copper warms and its resistance rises,
//   R = R_0 (1 + alpha (T - T_0));
// the supply limits the current to U / R; and, with one thermal mass a coil,
//   C dT/dt = I^2 R - (T - T_0) / R_th
// by Euler's rule: the time constant C R_th, 385 s by default, is far above the step.
void CoilBank::step(Time start) {
  while (!commands_.empty() && commands_.front().acts_from <= start) {
    target_ = commands_.front().currents;
    commands_.pop_front();
  }
  const bool on = !relay_ || relay_->on(start);
  for (int coil = 0; coil < currents_.size(); ++coil) {
    const double warmth = temperatures_[coil] - settings_.ambient;
    const double resistance =
        settings_.resistance * std::max(1 + settings_.temperature_coefficient * warmth, 0.1);
    const double most = settings_.supply_voltage / resistance;
    const double target = on ? std::clamp(target_[coil], -most, most) : 0;
    double& current = currents_[coil];
    const double before = current;
    current = std::clamp(target + keep_ * (current - target), -most, most);
    // Elastoplastic stop operator (Prandtl; Brokate & Sprekels 1996, 2.1). In an open core
    // H = N M + H_i: the demagnetizing factor N sets the slope, and the iron's own H_i, which has
    // the hysteresis, rises after a reversal as M / chi_i, a part 1 / (chi_i N) of it, up to the
    // coercive field.
    lagging_[coil] = std::clamp(lagging_[coil] + settings_.reversal_slope * (current - before),
                                -settings_.remanence, settings_.remanence);
    temperatures_[coil] += kCoilStep / settings_.heat_capacity *
                           (current * current * resistance - warmth / settings_.thermal_resistance);
  }
}

// The core's magnetization over the current: linear well below saturation, as annealed iron is,
// with a knee of the fourth power: i / (1 + (i / s)^4)^(1/4).
control::Currents CoilBank::effective() const {
  control::Currents field = currents_ - lagging_;
  for (int coil = 0; coil < field.size(); ++coil) {
    if (settings_.saturation > 0) {
      const double part = field[coil] / settings_.saturation;
      const double square = part * part;
      field[coil] /= std::sqrt(std::sqrt(1 + square * square));
    }
    field[coil] *=
        1 + settings_.gain_temperature_coefficient * (temperatures_[coil] - settings_.ambient);
    field[coil] *= response_[coil];
  }
  return field;
}

// White current noise, one sample a step; a dead coil has none.
control::Currents CoilBank::noisy(std::mt19937_64& random) {
  control::Currents flowing = effective();
  for (double& current : flowing) current += settings_.noise * normal_(random);
  for (const int coil : settings_.dead) flowing[coil - 1] = 0;
  return flowing;
}

}  // namespace vitreo::sim
