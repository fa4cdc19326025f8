// What every Lamp owes its callers, as a check that runs on emulators and on real instruments
// alike.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/roles/lamp.h"

#include <functional>
#include <string>
#include <vector>

namespace vitreo::contract {

struct LampCheck {
  double level = 0.05;  ///< how bright it gets
  /// The light that there really is, as a level, where somebody can tell; else nothing.
  std::function<double()> measured{};
  double tolerance = 1e-3;
};

/// Switches the lamp on and off and leaves it dark. Returns one sentence for each duty that it
/// fails; none is good. Lets Stopped pass; takes every other exception as a finding.
std::vector<std::string> check(Lamp& lamp, const LampCheck& how = {});

}  // namespace vitreo::contract
