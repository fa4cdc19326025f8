// Handles that every script is given.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/lua/interpreter/binding.h"
#include "host/rig/rig.h"

namespace vitreo::lua {

constexpr double kTalk = 10;  // s: for a few exchanges, each of which has a deadline of its own

/// The handle with a field for each role that is there.
void push_rig(lua_State* L, Rig& rig);
void push_run(lua_State* L);
int open_servo(Call& call);
/// What the rig believes: its eye, its view, its numbers.
std::vector<Binding> rig_model_rows();

}  // namespace vitreo::lua
