// Makes the Lua script engine.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/script_engine.h"

#include <memory>
#include <string>
#include <vector>

namespace vitreo {

/// `library_folders`: where require looks (the project's scripts/), nowhere else.
std::unique_ptr<ScriptEngine> make_lua_engine(const std::vector<std::string>& library_folders);

}  // namespace vitreo
