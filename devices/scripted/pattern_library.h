// Pattern functions of an instrument's file: string.find, match, gmatch and gsub with bounded work.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <lua.hpp>

namespace vitreo::scripted {

/// Puts them in the place of Lua's own: [string table] -> [string table].
void open_patterns(lua_State* L);

}  // namespace vitreo::scripted
