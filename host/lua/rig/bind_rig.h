// Handles that every script is given.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/time/identity.h"
#include "host/lua/interpreter/binding.h"
#include "host/lua/interpreter/tables.h"
#include "host/rig/rig.h"

#include <vector>

namespace vitreo::lua {

constexpr double kTalk = 10;  // s: for a few exchanges, each of which has a deadline of its own

/// The handle with a field for each role that is there.
void push_rig(lua_State* L, Rig& rig);
/// Calls of the rig about instruments by their kind.
std::vector<Binding> rig_instrument_rows();
/// The handle of an instrument under a name of the rig file's own; its methods are made from what
/// it declares.
void push_free_role(lua_State* L, const FreeRole& role);
void push_run(lua_State* L);
int open_servo(Call& call);
/// What the rig believes: its eye, its view, its numbers.
std::vector<Binding> rig_model_rows();
/// The field of its coils by the robot's own motion.
std::vector<Binding> rig_field_rows();
/// The fields identity, name, serial and firmware of an instrument's info().
void set_identity(ResultTable& table, const Identity& identity);
/// Their rows, and `more` behind them.
std::vector<ResultField> identity_fields(std::vector<ResultField> more);

}  // namespace vitreo::lua
