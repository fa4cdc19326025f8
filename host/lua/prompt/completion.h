// Completion of a half-written line, from the live objects and from the rows of the bindings.
// Nothing is called for it: neither methods nor metamethods.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <lua.hpp>

#include <cstddef>
#include <string>
#include <vector>

namespace vitreo::lua {

/// The words that may stand instead of the one that ends at `cursor` (see LineEditor::Complete),
/// sorted.
std::vector<std::string> completions(lua_State* L, const std::string& line, std::size_t cursor);

/// Pushes what "rig.stage" names now, or nil.
void push_path(lua_State* L, const std::string& path);
/// The row that "rig.stage:move_to", "control.line" or "help" names now; nulls where it is none.
struct Bound;
Bound bound_path(lua_State* L, const std::string& path);

}  // namespace vitreo::lua
