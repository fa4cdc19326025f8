// Environment of rig files: the part of Lua that computes, without files, clock and chance.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <lua.hpp>

namespace vitreo::lua {

/// Pushes the table that a rig file has in the globals' place: units, require "units", math without
/// random numbers, string, table, and the basic functions for loops, conversions and errors. It is
/// the same at every reading, so two readings give the same rig. Changes the string library of L:
/// calls that could go on without end inside one C function, where no count of instructions ends
/// them, are refused by their size. L must serve this one file.
void push_rig_environment(lua_State* L);

}  // namespace vitreo::lua
