// Wait of a host call: what the script's task is suspended for.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/time/clock.h"

#include <functional>
#include <string>

namespace vitreo::lua {

class Call;

/// What a host call waits for. After it the call goes on in `finish`, which pushes the results and
/// returns their number; `in_time` is what `ready` said last. Without `ready` only the deadline
/// ends the wait.
struct Wait {
  Signal* signal = nullptr;     // null: nothing but time
  std::function<bool()> ready;  // looked at after each notification; it may throw
  Time deadline = kForever;
  std::function<int(Call&, bool in_time)> finish;
  bool ends_children = false;  // run:together: a stop goes to the children, not to this wait
  std::string what{};          // as the status shows it; Call::wait fills in the call's name
};

}  // namespace vitreo::lua
