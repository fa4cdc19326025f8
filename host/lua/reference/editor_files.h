// Files for editors, printed from the rows of the bindings: stubs for the Lua language server, and
// luacheck's standard. The functions of scripts/ need none: the server reads their comments there.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <string>

namespace vitreo::lua {

struct Library;

/// File names and texts: vitreo.lua with every class and function, units.lua and one file a module,
/// for require.
std::map<std::string, std::string> lua_stubs(const Library& library);
/// A .luacheckrc: what a script may read, so that a name that nobody knows is an error.
std::string luacheck_standard(const Library& library);

}  // namespace vitreo::lua
