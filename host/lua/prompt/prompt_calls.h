// Calls of the prompt beside those of scripts: run("name", {...}), check("name", {...}),
// watch(object), units without their table; and the protocols by name.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/lua/interpreter/binding.h"
#include "host/lua/interpreter/context.h"
#include "host/session/script_engine.h"

#include <map>
#include <string>
#include <vector>

namespace vitreo::lua {

/// Of that name or file; throws std::invalid_argument with what was perhaps meant, ScriptError
/// where it is none.
ProtocolDescription named_protocol(const Context& context, const std::string& name);
/// The roles that it needs; throws std::invalid_argument for one that the rig has not.
void check_roles(const ProtocolDescription& protocol, const Rig& rig);
/// Those of the table, or none, at `table`: SI, or texts with units. Throws std::invalid_argument,
/// ConfigError.
std::map<std::string, ArgumentValue> given_parameters(lua_State* L, int table,
                                                      const ProtocolDescription& protocol);

/// check(), show(), plot(): rows that only the prompt has.
const std::vector<Binding>& prompt_functions();

/// Sets the globals rig, run, units, check, watch, follow, show, plot; makes `run` callable and
/// units known by their bare names.
void open_prompt_calls(lua_State* L);

}  // namespace vitreo::lua
