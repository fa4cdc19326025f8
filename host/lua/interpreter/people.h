// Waits for an operator's answer, at the terminal or through the control socket.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/lua/interpreter/binding.h"
#include "host/lua/interpreter/wait.h"

#include <functional>
#include <string>

namespace vitreo::lua {

/// In real time the clock goes on, and the loop with it; otherwise it stands still, so that the
/// answer comes at the same time in every run of the same seed. After `limit` seconds of wall time
/// it is std::runtime_error.
Wait wait_for_people(const Call& call, const std::string& what, const std::function<bool()>& ready,
                     const std::function<int(Call&)>& then, double limit);

}  // namespace vitreo::lua
