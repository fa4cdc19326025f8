// Texts of `vitreo new instrument`: an instrument of one Lua file with its emulator, and a rig with
// it.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

namespace vitreo::cli {

/// What a rig calls it: the kind of a fixed role, else its own name.
std::string role_of_instrument(const std::string& name, const std::string& kind);

/// The file, from the kind's template. `link`: serial, tcp, udp, usbtmc, vxi11, hislip or modbus.
/// Throws ConfigError for a kind or a link that there is not, and for a name that a role has.
std::string instrument_text(const std::string& name, const std::string& kind,
                            const std::string& link);
/// A rig with it, emulated, and how its real address is written.
std::string instrument_rig_text(const std::string& name, const std::string& kind,
                                const std::string& link);

const std::vector<std::string>& instrument_links();

}  // namespace vitreo::cli
