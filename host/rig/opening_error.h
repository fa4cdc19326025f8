// Errors of opening an instrument, with what only its rig knows: the role, its address, and which
// other instruments are on lines of the same kind.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/time/error.h"

#include <nlohmann/json.hpp>

#include <string>

namespace vitreo {

/// `error` of opening the role, under its name. `rig` as resolved, {role: {driver, address}}; null:
/// not known. Of an amplifier that never came to a driver it also says that no zero was sent.
DeviceError opening_error(const DeviceError& error, const std::string& role,
                          const std::string& address, const nlohmann::json* rig);

}  // namespace vitreo
