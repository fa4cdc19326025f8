// Contract suite of OperatorInput: the duties of the role, checked alike on emulators and real
// instruments.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/roles/operator_input.h"
#include "devices/time/clock.h"

#include <string>
#include <vector>

namespace vitreo::contract {

/// Reads it for a second, untouched or not. Returns one sentence for each duty that it fails;
/// none is good. Lets Stopped pass; takes every other exception as a finding.
std::vector<std::string> check(OperatorInput& input, Clock& clock);

}  // namespace vitreo::contract
