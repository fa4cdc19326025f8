// Contract suite of FieldProbe: the duties of the role, checked alike on emulators and real
// instruments.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/roles/field_probe.h"

#include <functional>
#include <string>
#include <vector>

namespace vitreo::contract {

struct FieldProbeCheck {
  Time timeout = std::chrono::seconds(5);  ///< of each measurement
  /// The field that really is there, in T, where it can be known; else null.
  std::function<std::vector<double>()> really{};
  double tolerance = 10e-6;  ///< T
  /// Makes the instrument take tens of milliseconds to answer (true), and as long as before
  /// (false), where that can be done: on the wall clock of a busy machine an answer that comes at
  /// once may be there before the question's own thread goes on, and no deadline is missed.
  std::function<void(bool slow)> answer{};
};

/// Measures; returns one sentence for each duty that it fails. Lets Stopped pass.
std::vector<std::string> check(FieldProbe& probe, Clock& clock, const FieldProbeCheck& how = {});

}  // namespace vitreo::contract
