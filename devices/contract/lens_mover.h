// Contract suite of LensMover: the duties of the role, checked alike on emulators and real
// instruments.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/roles/lens_mover.h"
#include "devices/time/clock.h"

#include <functional>
#include <string>
#include <vector>

namespace vitreo::contract {

struct LensMoverCheck {
  double fraction = 0.1;                    ///< of the travel: how far it is moved either way
  double tolerance = 1e-6;                  ///< m, between its target and its position
  Time timeout = std::chrono::seconds(60);  ///< of one move, and of homing
  /// Where the lens really is, in m, where it can be known; else null.
  std::function<double()> measured;
};

/// Homes the mover when it must, moves it round the middle of its travel, and leaves it standing
/// there. Returns one sentence for each duty that it fails; none is good. Lets Stopped pass; takes
/// every other exception as a finding.
std::vector<std::string> check(LensMover& mover, const LensMoverCheck& how = {});

}  // namespace vitreo::contract
