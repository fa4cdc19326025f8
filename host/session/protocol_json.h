// Description of a protocol as JSON, for programs: `vitreo describe --json` and the workbench.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/session/script_engine.h"

#include <nlohmann/json.hpp>

namespace vitreo {

/// Numbers in SI; a bound that is not finite is left out, since JSON has no infinity.
nlohmann::json to_json(const Parameter& parameter);
nlohmann::json to_json(const ProtocolDescription& protocol);

}  // namespace vitreo
