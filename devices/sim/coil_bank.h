// Coils and their amplifiers: delay, lag, noise and heat, and their cores: saturation and
// hysteresis. The quantization is in the set-points, which come through the USB-3103's emulator in
// counts.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/coil_field.h"
#include "devices/sim/one_shot.h"
#include "devices/time/clock.h"

#include <deque>
#include <optional>
#include <random>
#include <vector>

namespace vitreo::sim {

struct CoilBankSettings {
  double bandwidth = 15;  // Hz, first order (facts/magnetics 1.1)
  double delay = 50e-3;   // s, from a new set-point to the first change of current
  double noise = 10e-3;   // A, standard deviation per coil and step of 1 ms
  double resistance = 1;  // ohm of a cold coil (this and all of heat: assumed, 1.1)
  double temperature_coefficient = 3.93e-3;  // 1/K, of copper
  double heat_capacity = 770;                // J/K: 2 kg of copper
  double thermal_resistance = 0.5;           // K/W to the surroundings
  double ambient = 293.15;                   // K
  double supply_voltage = 48;  // V: a hot coil's current is at most this over its resistance
  // 1/K: what a coil's field per ampere gains as it warms; negative, it falls
  double gain_temperature_coefficient = 0;
  double saturation = 0;  // A: of the field of a core that is saturated; 0: it is linear
  // Hysteresis of the cores. A: the field that is left at zero current is that of up to this; 0:
  // none. After a reversal it stays behind by this part of the current's change, until that is the
  // remanence.
  double remanence = 0;
  double reversal_slope = 0.01;
  std::vector<int> dead;        // coils that carry no current, counted from 1
  double one_shot = 0;          // s, of the relay of a heartbeat line; 0: the amplifiers are on
  void check(int coils) const;  // throws std::invalid_argument naming the parameter
};

class CoilBank {
 public:
  CoilBank(const CoilBankSettings& settings, int coils);
  /// New set-points, A, that act from `time` + delay on. Times must not run backwards.
  void command(Time time, const control::Currents& set_points);
  /// The heartbeat line, at `time`: without its edges the amplifiers give nothing, whatever they
  /// are told. Times must not run backwards.
  void set_line(Time time, bool high);
  /// Part of the current of a coil (from 1) that makes field from now on, 1 where nothing is wrong
  /// with it: windings that are shorted carry what the amplifier gives and make less.
  void set_response(int coil, double part);
  /// One step of 1 ms from `start`: currents and temperatures of its end.
  void step(Time start);
  const control::Currents& currents() const { return currents_; }          // A, without the noise
  const control::Currents& temperatures() const { return temperatures_; }  // K
  /// A: what would make the same field in cold coils whose cores are linear and remember nothing.
  control::Currents effective() const;
  control::Currents noisy(std::mt19937_64& random);  // A, effective with the amplifiers' noise

 private:
  struct Command {
    Time acts_from;
    control::Currents currents;
  };
  CoilBankSettings settings_;
  double keep_;  // part of the distance to the set-point that is left after a step
  std::optional<OneShot> relay_;
  std::deque<Command> commands_;
  control::Currents target_;
  control::Currents currents_;
  control::Currents temperatures_;
  control::Currents response_;  // of each coil's current that makes field
  control::Currents lagging_;   // A: hysteresis, what the fields are behind the currents
  std::normal_distribution<double> normal_;
};

}  // namespace vitreo::sim
