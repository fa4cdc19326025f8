// Description of a protocol as text, for `vitreo describe` and help() at the prompt.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/session/script_engine.h"

#include <string>

namespace vitreo {

/// A parameter's value in display units: "0.5 mm", "100 µm", "true". `unit`: as declared.
std::string value_text(const ArgumentValue& value, const std::string& unit);
/// The same as it can be typed: "100 um".
std::string plain_value_text(const ArgumentValue& value, const std::string& unit);
/// Name, title, what it does, roles, rig, and its parameters with units, ranges and defaults;
/// lines.
std::string protocol_text(const ProtocolDescription& protocol);

}  // namespace vitreo
