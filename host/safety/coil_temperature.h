// Thermal model of the coils: temperatures estimated from the currents that were sent, for the
// interlock, where nothing measures them.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <vector>

namespace vitreo {

/// One lumped body a coil (I2t): C dT/dt = R(T) I^2 - (T - ambient) / R_th. The defaults are
/// assumed, for 2 kg of copper; no published source gives the thesis' coils.
struct CoilHeat {
  double resistance = 1;                     // ohm, at ambient
  double temperature_coefficient = 3.93e-3;  // 1/K, of copper
  double heat_capacity = 770;                // J/K
  double thermal_resistance = 0.5;           // K/W
  double ambient = 293.15;                   // K
  double limit = 373.15;                     // K: a hotter coil opens the interlock
  void check() const;                        // throws std::invalid_argument naming the parameter
};

class CoilTemperature {
 public:
  /// At ambient: what an earlier run or another program has heated is not known.
  CoilTemperature(const CoilHeat& heat, int coils);
  /// `seconds` at constant `currents`, A; one a coil. Exact for constant resistance over at most 1
  /// s; longer spans are cut into such.
  void advance(double seconds, std::span<const double> currents);
  const std::vector<double>& temperatures() const { return temperatures_; }  // K
  double hottest() const;                                                    // K

 private:
  CoilHeat heat_;
  std::vector<double> temperatures_;
};

}  // namespace vitreo
