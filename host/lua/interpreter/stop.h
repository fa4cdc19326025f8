// Stop of a script: the object that is thrown through it, and the hooks that throw it.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <lua.hpp>

#include <cstddef>

namespace vitreo::lua {

struct Context;

/// The object that a stop throws through a script: nothing may catch it for good.
void push_stop(lua_State* L);
bool is_stop(lua_State* L, int index);
/// Counts the stop for the running task, disarms the hook, and throws the stop.
[[noreturn]] void raise_stop(lua_State* L);

/// How many stops the running task has felt.
std::size_t stops_felt(lua_State* L);
/// Raises the stop anew where one was felt since there were `before`: what was called may have put
/// an error of its own, a result or a yield in its place.
void let_stop_pass(lua_State* L, std::size_t before);

/// A stop asked for by the engine's interrupt() becomes the one that is raised: the clock's own, of
/// the same key press, is used up, so that the clean-up can wait. An abort makes the devices safe
/// here, before the script goes on.
void take_interrupt(Context& context);
/// From now on the script's waits have the budget of a clean-up.
void limit_clean_up(Context& context);

/// In the midst of a C function that can take long, after some thousand steps of it: raises what
/// the hook would.
void feel_stop(lua_State* L);

/// Arms the hook that throws a stop into L. Async-signal-safe on the thread that runs L.
void arm_stop(lua_State* L) noexcept;
/// Limits what a file that is only being read may do before it is given up.
void arm_reading_limit(lua_State* L);

}  // namespace vitreo::lua
