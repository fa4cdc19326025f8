// Contract suite of instruments of free kinds: what their declarations promise is so.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/roles/instrument.h"

#include <string>
#include <vector>

namespace vitreo::contract {

/// Reads every quantity that can be read, tries what lies beyond the bounds of those that can be
/// set (which must be refused), sets none and gives no command, and makes it safe twice. A sentence
/// a finding.
std::vector<std::string> check(Instrument& instrument);

}  // namespace vitreo::contract
