// Description of a protocol as text, for `vitreo describe` and help() at the prompt.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/session/script_engine.h"

#include <string>

namespace vitreo {

/// A parameter's value in display units: "0.5 mm", "100 µm", "0, 1, −3 mm", "true".
std::string value_text(const Parameter& parameter, const ArgumentValue& value);
/// The same as it can be typed: "100 um", "0 m,1 mm,-3 mm".
std::string plain_value_text(const Parameter& parameter, const ArgumentValue& value);
/// Name, title, what it does, roles, rig, and its parameters with units, ranges and defaults;
/// lines.
std::string protocol_text(const ProtocolDescription& protocol);

}  // namespace vitreo
