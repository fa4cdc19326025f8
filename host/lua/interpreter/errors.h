// Failures on their way between C++ and Lua.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <lua.hpp>

#include <exception>
#include <functional>
#include <string>

namespace vitreo::lua {

/// Runs `body` and turns what it throws into a Lua error: "file:line: prefix: what". Lua's own
/// errors, thrown pointers, pass. Never hold a C++ object that outlives the call where Lua errors
/// may be thrown by lua_error itself: it unwinds.
int guarded(lua_State* L, const std::string& prefix, const std::function<int()>& body);

/// Runs `body` where Lua errors are caught, on a stack of its own that starts with the `arguments`
/// on top of L; what it leaves there is what L gets. Throws what body throws, and ScriptError,
/// DeviceError, Stopped for Lua errors.
void in_lua(lua_State* L, int arguments, const std::function<void()>& body);

/// The message handler of tasks: remembers the trace and the place.
int remember_trace(lua_State* L);
/// The error object at `index` as one line; never an address.
std::string error_text(lua_State* L, int index);
/// Takes the error object from the top, after `status`, and makes Stopped, DeviceError or
/// ScriptError of it. Safe where no Lua error could be caught.
std::exception_ptr to_exception(lua_State* L, int status);

/// Makes the metatable of device errors.
void open_errors(lua_State* L);

}  // namespace vitreo::lua
