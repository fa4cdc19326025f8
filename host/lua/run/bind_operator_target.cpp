// Bindings of run: positions that the operator points at in the live view.
// SPDX-License-Identifier: Apache-2.0
#include "host/lua/interpreter/binding.h"
#include "host/lua/interpreter/context.h"
#include "host/lua/interpreter/values.h"
#include "host/lua/run/classes.h"

namespace vitreo::lua {
namespace {

/// Takes what was pointed at: each click is given once. That a script has asked at all is what
/// makes the view offer the pointing (OperatorTargets).
int operator_target(Call& call) {
  const auto places = session_of(call.L).targets.take();
  if (!places) return 0;
  lua_createtable(call.L, static_cast<int>(places->size()), 0);
  for (std::size_t i = 0; i < places->size(); ++i) {
    push_vector(call.L, (*places)[i]);
    lua_rawseti(call.L, -2, static_cast<lua_Integer>(i + 1));
  }
  return 1;
}

}  // namespace

std::vector<Binding> run_operator_rows() {
  return {{"operator_target",
           {},
           Returned("list of positions", "m").or_nil(""),
           "the places to which the operator wants the robot since the last call, to be passed "
           "one after the other; "
           "the live view offers to point at them from the first call on",
           operator_target,
           "run:operator_target()"}};
}

}  // namespace vitreo::lua
