// Factory of the Lua script engine.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/session/script_engine.h"

#include <memory>
#include <string>
#include <vector>

namespace vitreo {

/// `library_folders`: where require looks (the project's scripts/), nowhere else.
/// `protocol_folders`: where the prompt's run("name") looks.
std::unique_ptr<ScriptEngine> make_lua_engine(
    const std::vector<std::string>& library_folders,
    const std::vector<std::string>& protocol_folders = {});

}  // namespace vitreo
