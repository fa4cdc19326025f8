// Examination of a rig's instruments: identity and state of each role, and the contract suites on
// real instruments (`vitreo devices --rig`).
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/config/config.h"

#include <nlohmann/json.hpp>

#include <string>
#include <vector>

namespace vitreo {

/// Opens each role of the rig on its own, and closes it again: [{"role", "driver", "link",
/// "present", "identity", "state", ...}]; where it is not present, "why". Currents and motion stay
/// as open() leaves them: zero and still. Throws ConfigError.
nlohmann::json examine_rig(const RigDescription& description);

/// Runs the contract suite of the role `name` on the rig's instrument: it moves, or drives
/// currents! Returns a sentence for each duty that fails. Throws ConfigError for a role that the
/// rig has not or that has no suite, DeviceError.
std::vector<std::string> test_instrument(const RigDescription& description,
                                         const std::string& name);

/// As a table for people; also of what find_instruments() finds.
std::string to_text(const nlohmann::json& rows);

}  // namespace vitreo
