// The API reference in docs/reference/api.md, printed from the rows of the bindings and from the
// comments in scripts/.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/lua/reference/script_library.h"

#include <string>
#include <vector>

namespace vitreo::lua {

struct Library;

/// Everything that scripts can call, as Markdown: the card of everyday calls, the rows, the modules
/// of `scripts`.
std::string api_reference(const Library& library, const std::vector<ScriptModule>& scripts);

}  // namespace vitreo::lua
