// Blocking calls of devices and long calculations, each as a task of the clock that a script waits
// for.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/lua/interpreter/binding.h"
#include "host/lua/interpreter/wait.h"

#include <functional>
#include <string>

namespace vitreo::lua {

/// What an error says of a wait that took too long, beside operation, time and the script's line.
struct WaitInfo {
  std::string target{};  // "1.5 mm"; empty: none
  std::function<std::string()>
      reading{};  // where it is now; called on the job's task, may throw. Null: none
};

/// "wanted 1.5 mm; last reading 0.2 mm; after 60 s"; `reading` may be empty.
std::string waited_text(const std::string& target, const std::string& reading, double elapsed);

/// A wait for a blocking call that runs as a task of the clock, for the device `name`. Past
/// `timeout` it is stopped and std::runtime_error thrown; the device's own DeviceError{timeout}
/// goes on with what `about` knows added.
Wait work(const Call& call, const std::string& name, std::function<void()> blocking, Time timeout,
          std::function<int(Call&)> finish, WaitInfo about = {});

}  // namespace vitreo::lua
