// What is plugged in, what a rig file's roles find, and the contract suites on real instruments: `vitreo devices`.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/config.h"

#include <nlohmann/json.hpp>

#include <string>
#include <vector>

namespace vitreo {

/// What is plugged in: [{"bus", "address", "name", "place", "driver"}], driver empty where none would take it.
/// Looking for GenICam cameras takes a second. A bus that cannot be looked at is a row with "problem".
nlohmann::json find_instruments();
/// The driver that would take a USB or HID device; empty: none.
std::string driver_for(int vendor, int product);

/// Opens each role of the rig on its own, and closes it again: [{"role", "driver", "link", "present", "identity",
/// "state", ...}]; where it is not present, "why". Currents and motion stay as open() leaves them: zero and still.
/// Throws ConfigError.
nlohmann::json examine_rig(const RigDescription& description);

/// Runs the contract suite of the role `name` on the rig's instrument: it moves, or drives currents! Returns a sentence
/// for each duty that fails. Throws ConfigError for a role that the rig has not or that has no suite, DeviceError.
std::vector<std::string> test_instrument(const RigDescription& description, const std::string& name);

/// As a table for people.
std::string to_text(const nlohmann::json& rows);

}  // namespace vitreo
