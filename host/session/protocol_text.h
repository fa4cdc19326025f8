// Description of a protocol as text, for `vitreo describe` and help() at the prompt.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/session/script_engine.h"

#include <string>

namespace vitreo {

/// A parameter's value in its display unit: "0.5 mm", "true".
std::string value_text(const ArgumentValue& value, const std::string& unit);
/// Name, title, what it does, roles, rig, and its parameters with units, ranges and defaults;
/// lines.
std::string protocol_text(const ProtocolDescription& protocol);

}  // namespace vitreo
