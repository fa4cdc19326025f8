// What the prompt draws: images, plots and tables of records, on the terminal.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/lua/interpreter/binding.h"

#include <iosfwd>
#include <vector>

namespace vitreo::lua {

/// Where show() and plot() write, past everything that makes texts harmless: their escape sequences
/// are the program's own. `interactive`: to the terminal, with what it can show; else plain text.
void set_prompt_screen(lua_State* L, std::ostream& out, bool interactive);

/// show, plot: rows that only the prompt has.
std::vector<Binding> prompt_see_functions();

/// Sets the global follow; `run` is the handle that calls protocols.
void open_follow(lua_State* L);

}  // namespace vitreo::lua
