// What the prompt offers beside what scripts have: run("name", {...}), watch(object), units without their table; and
// the protocols by name.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/lua/context.h"
#include "host/script_engine.h"

#include <string>
#include <vector>

namespace vitreo::lua {

/// A file as given, else the name in one of the protocols' folders; "" where there is none.
std::string find_protocol(const Context& context, const std::string& name);
std::vector<std::string> protocol_names(const Context& context);
std::string protocol_help(const ProtocolDescription& protocol);

/// Sets the globals rig, run, units, watch; makes `run` callable and units known by their bare names.
void open_prompt_calls(lua_State* L);

}  // namespace vitreo::lua
