// Contract suite of Lamp: the duties of the role, checked alike on emulators and real instruments.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/roles/lamp.h"

#include <functional>
#include <string>
#include <vector>

namespace vitreo::contract {

struct LampCheck {
  double level = 0.05;  ///< how bright it gets
  /// The light that there really is, as a level, where it can be known; else null.
  std::function<double()> measured{};
  double tolerance = 1e-3;
};

/// Switches the lamp on and off and leaves it dark. Returns one sentence for each duty that it
/// fails; none is good. Lets Stopped pass; takes every other exception as a finding.
std::vector<std::string> check(Lamp& lamp, const LampCheck& how = {});

}  // namespace vitreo::contract
