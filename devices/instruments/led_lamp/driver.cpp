// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/led_lamp/driver.h"

#include <cmath>
#include <cstddef>
#include <stdexcept>
#include <utility>
#include <vector>

namespace vitreo::led_lamp {
namespace {

/// The lamp owns the amplifier: its other outputs stay at zero.
class LedLamp final : public Lamp {
 public:
  // Dark at once: the outputs may hold what another program has left.
  LedLamp(std::unique_ptr<CoilAmplifier> outputs, const Settings& settings)
      : outputs_(std::move(outputs)), settings_(settings) {
    outputs_->make_safe();
  }
  std::string identity() const override {
    return "LED on output " + std::to_string(settings_.output) + " of " + outputs_->identity();
  }
  void set_level(double level) override {
    // Written so that NaN is refused too.
    if (!(level >= 0 && level <= 1))
      throw std::invalid_argument("level: " + settings_.name + " takes 0 to 1");
    // Dark is the amplifier's safe state, not a set-point of zero: it also disables what it can.
    if (level == 0) return make_safe();
    std::vector<double> currents(static_cast<std::size_t>(outputs_->channels()), 0.0);
    currents[static_cast<std::size_t>(settings_.output)] = level * settings_.full_current;
    level_ = level;  // should the exchange fail half-way, it may shine
    outputs_->set_currents(currents);
  }
  double level() const override { return level_; }
  void ask() override { outputs_->measured_currents(); }
  LinkState link_state() const override { return outputs_->link_state(); }
  void make_safe() override {
    outputs_->make_safe();
    level_ = 0;
  }
  EnableLine* enable_line() override { return outputs_->enable_line(); }

 private:
  std::unique_ptr<CoilAmplifier> outputs_;  // its destruction leaves its outputs at zero
  const Settings settings_;
  double level_ = 0;
};

}  // namespace

void Settings::check() const {
  if (name.empty()) throw std::invalid_argument("name: must not be empty");
  if (output < 0) throw std::invalid_argument("output: counts from 0");
  if (!(std::isfinite(full_current) && full_current > 0))
    throw std::invalid_argument("full_current: must be positive");
}

// What the settings and the amplifier say together can be checked only here.
std::unique_ptr<Lamp> open(std::unique_ptr<CoilAmplifier> outputs, const Settings& settings) {
  if (!outputs) throw std::invalid_argument("outputs: must not be null");
  settings.check();
  if (settings.output >= outputs->channels())
    throw std::invalid_argument("output: there are " + std::to_string(outputs->channels()) +
                                ", counted from 0");
  if (settings.full_current > outputs->current_limit())
    throw std::invalid_argument("full_current: is beyond what the output gives");
  return std::make_unique<LedLamp>(std::move(outputs), settings);
}

}  // namespace vitreo::led_lamp
