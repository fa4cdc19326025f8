// Contract suite of CoilAmplifier: the duties of the role, checked alike on emulators and real
// instruments.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/roles/coil_amplifier.h"

#include <functional>
#include <string>
#include <vector>

namespace vitreo::contract {

struct CoilAmplifierCheck {
  double fraction = 0.05;  ///< of the current limit: how far the coils are driven
  /// The currents that really flow, in A, where they can be known (an emulator, a field probe);
  /// else null.
  std::function<std::vector<double>()> measured;
  double tolerance = 1e-3;  ///< A, between the set and the measured currents
};

/// Drives the amplifier through its duties and leaves it safe. Returns one sentence for each duty
/// that it fails; none is good. Lets Stopped pass; takes every other exception as a finding.
std::vector<std::string> check(CoilAmplifier& amplifier, const CoilAmplifierCheck& how = {});

}  // namespace vitreo::contract
