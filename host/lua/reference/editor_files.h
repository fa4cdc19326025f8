// Files printed from the rows of the bindings: stubs for the Lua language server, luacheck's
// standard, the API reference.
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
/// The reference of everything scripts can call: Markdown.
std::string api_reference(const Library& library);

}  // namespace vitreo::lua
