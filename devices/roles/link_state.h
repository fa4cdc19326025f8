// State of an instrument's links, as it shows without a question.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/time/clock.h"

#include <string>

namespace vitreo {

struct LinkState {
  /// Which far end has gone, its cable out or its connection ended; empty: none.
  std::string hung_up;
  Time owed = Time::zero();  ///< for how long an answer has been owed; zero: none is
};

/// Why the instrument cannot be trusted to hold what it was told; empty where no far end has gone.
inline std::string gone_text(const LinkState& links) {
  if (links.hung_up.empty()) return "";
  return links.hung_up + " has hung up: its cable is out, or it has lost its power";
}

}  // namespace vitreo
