// Motion that a script has set a stage off for: whether it goes on, and how it ended.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/time/clock.h"
#include "host/lua/interpreter/binding.h"

#include <exception>
#include <functional>
#include <memory>
#include <string>

namespace vitreo::lua {

/// One motion of a stage or a rotation stage, which outlives it. A role keeps the ending of its
/// last motion only, and tells it to one caller; this keeps it for every caller of motion:wait and
/// motion:done, and past the next motion. Its functions are called on tasks of the clock.
struct Motion {
  std::string device;                    // "stage"
  std::string target;                    // as people read it: "5 mm"
  std::function<bool()> moving;          // of the role, as the two below
  std::function<void(Time)> wait;        // throws DeviceError
  std::function<std::string()> reading;  // where it is now: "2 mm"; may throw
  bool ended = false;
  std::exception_ptr ending;  // DeviceError: why it is not at its target; null: it arrived
};

/// Waits for the end. Throws how it ended, unless at its target, each time again; at the deadline
/// the stage is stopped, and DeviceError{timeout} is that ending.
void wait_for_end(Motion& motion, Time timeout);
/// Asks the stage. Throws DeviceError where it does not answer.
bool has_ended(Motion& motion);

/// The motions of one stage.
struct StageMotions {
  std::shared_ptr<Motion> last;  // the last one that start() set off; null: none yet
};
/// To be called before the stage is told to move: what it will forget then goes to the handle of
/// the motion before. While that one goes on it does nothing, and the stage refuses the new one.
void keep_ending(const StageMotions& motions);

/// How long a device may take until it counts as hanging, past its own deadline of `timeout`, at
/// which it stops itself.
Time hang_limit(Time timeout);

}  // namespace vitreo::lua
