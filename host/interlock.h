// What stands between every command and the coils, and cannot be by-passed: a decorator of the amplifier's role.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/coil_amplifier.h"

#include <memory>

namespace vitreo {

struct InterlockLimits {
  double current = 12;        // A, per channel
  double total_current = 60;  // A, sum of magnitudes
  void check() const;         // throws std::invalid_argument naming the limit
};

/// Refuses (DeviceError{refused}, the outputs go to zero) what is beyond a limit or not a number. After make_safe() it
/// stays at zero, and refuses, until enable().
class Interlock : public CoilAmplifier {
 public:
  Interlock(CoilAmplifier& amplifier, const InterlockLimits& limits);
  std::string identity() const override { return amplifier_.identity(); }
  int channels() const override { return amplifier_.channels(); }
  double current_limit() const override;
  double total_limit() const { return limits_.total_current; }  // A, sum of magnitudes
  void set_currents(std::span<const double> currents) override;
  std::vector<double> currents() const override { return amplifier_.currents(); }
  void make_safe() override;
  bool enabled() const { return enabled_; }
  /// Lets set-points through again; the outputs stay at zero until one comes.
  void enable() { enabled_ = true; }

 private:
  CoilAmplifier& amplifier_;
  InterlockLimits limits_;
  bool enabled_ = true;
};

}  // namespace vitreo
