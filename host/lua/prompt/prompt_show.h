// Text of what the prompt shows: values in display units, errors with the user's own lines.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/lua/interpreter/context.h"

#include <string>
#include <vector>

namespace vitreo::lua {

/// Numbers in the unit of the call that gave them (`from`), long tables over several lines.
std::string show_value(lua_State* L, int index, const Context::Result& from);

/// The message, then the lines of Lua that led there, the innermost first. `typed`: every line of
/// the session, from 1. `plain`: a line that need not be repeated, since it stands right above.
std::string show_error(const std::string& message, const std::string& trace,
                       const std::vector<std::string>& typed, int plain);

}  // namespace vitreo::lua
