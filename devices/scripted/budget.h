// Budget of a script's call, for the library that it uses.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <lua.hpp>

#include <cstdint>

namespace vitreo::scripted::budget {

/// What is left until the next operation, in instructions.
std::int64_t left(lua_State* L);
/// Takes work that no count of instructions sees; an error of Lua's where that is more than is
/// left.
void charge(lua_State* L, std::int64_t work);
/// The same without the error, which comes with the next instruction.
void spend(lua_State* L, std::int64_t work);

}  // namespace vitreo::scripted::budget
