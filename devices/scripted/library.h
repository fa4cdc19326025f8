// Library of an instrument's file: what of Lua's own functions it has, each charged for the work
// that no count of instructions sees.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <lua.hpp>

namespace vitreo::scripted {

/// Opens it as the globals of a fresh state, whose extra space holds its Sandbox.
void open_library(lua_State* L);

}  // namespace vitreo::scripted
