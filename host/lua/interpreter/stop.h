// Stop of a script: the object that is thrown through it, and the hooks that throw it.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <lua.hpp>

namespace vitreo::lua {

struct Context;

/// The object that a stop throws through a script: nothing may catch it for good.
void push_stop(lua_State* L);
bool is_stop(lua_State* L, int index);
/// Counts the stop for the running task, disarms the hook, and throws the stop.
[[noreturn]] void raise_stop(lua_State* L);

/// A stop asked for by the engine's interrupt() becomes the one that is raised: the clock's own, of
/// the same key press, is used up, so that the clean-up can wait. An abort makes the devices safe
/// here, before the script goes on.
void take_interrupt(Context& context);
/// From now on the script's waits have the budget of a clean-up.
void limit_clean_up(Context& context);

/// Arms the hook that throws a stop into L. Async-signal-safe on the thread that runs L.
void arm_stop(lua_State* L) noexcept;
/// Limits what a file that is only being read may do before it is given up.
void arm_reading_limit(lua_State* L);

}  // namespace vitreo::lua
