// Bindings of a motion: the handle that stage:start and rotation_stage:start return.
// SPDX-License-Identifier: Apache-2.0
#include "host/lua/rig/motion.h"

#include "devices/time/error.h"
#include "host/lua/interpreter/context.h"
#include "host/lua/interpreter/tables.h"
#include "host/lua/interpreter/work.h"
#include "host/lua/rig/bind_rig.h"
#include "host/lua/rig/classes.h"

namespace vitreo::lua {
namespace {

constexpr double kLongestMotion = 3600;  // s
constexpr double kUsualMotion = 60;      // s

std::shared_ptr<Motion> motion_of(const Call& call) {
  return std::static_pointer_cast<Motion>(call.self_pointer());
}

int motion_done(Call& call) {
  const auto motion = motion_of(call);
  auto done = std::make_shared<bool>(false);
  return call.wait(work(
      call, motion->device, [motion, done] { *done = has_ended(*motion); }, from_seconds(kTalk),
      [done](Call& then) { return then.flag(*done); }));
}

int motion_wait(Call& call) {
  const auto motion = motion_of(call);
  const Time timeout = from_seconds(call.number_option("timeout").value_or(kUsualMotion));
  return call.wait(work(
      call, motion->device, [motion, timeout] { wait_for_end(*motion, timeout); },
      hang_limit(timeout), [](Call&) { return 0; }, {motion->target, motion->reading}));
}

}  // namespace

// A stop of the script passes and leaves the motion as it is: the stage still moves, and the run's
// end makes it safe. Of two tasks that wait, one gets the ending from the role and the other gets
// nothing from it, so what is thrown is the kept one.
void wait_for_end(Motion& motion, Time timeout) {
  if (!motion.ended) {
    try {
      motion.wait(timeout);
    } catch (const DeviceError&) {
      if (!motion.ending) motion.ending = std::current_exception();
    }
    motion.ended = true;
  }
  if (motion.ending) std::rethrow_exception(motion.ending);
}

// The ending is taken from the role as soon as the motion is known to be over; wait() with no time
// left returns or throws it at once.
bool has_ended(Motion& motion) {
  if (motion.ended) return true;
  if (motion.moving()) return false;
  try {
    wait_for_end(motion, Time(0));
  } catch (const DeviceError&) {  // kept for motion:wait
  }
  return true;
}

void keep_ending(const StageMotions& motions) {
  if (motions.last) has_ended(*motions.last);
}

// Twice the deadline, because a stop at the deadline takes as long as the stage needs to stand, and
// a few exchanges.
Time hang_limit(Time timeout) { return 2 * timeout + from_seconds(kTalk); }

const Class& motion_class() {
  static const Class kind{
      "motion",
      "a motion that stage:start or rotation_stage:start has begun; it keeps how it ended, "
      "whatever "
      "the stage does afterwards",
      {{"done",
        {},
        "true or false",
        "whether it has ended, at its target or not; wait says which",
        motion_done,
        "motion:done()"},
       {"wait",
        {options_of(
            {{.name = "timeout",
              .type = Type::number,
              .unit = "s",
              .optional = true,
              .min = 0,
              .max = kLongestMotion,
              .help = "how long it may take from now on (60 s); then the stage is stopped"}})},
        "",
        "waits until it has ended, and returns at once when it has; an error, each time, when it "
        "did "
        "not end at its target",
        motion_wait,
        "motion:wait { timeout = 10 * s }"}}};
  return kind;
}

}  // namespace vitreo::lua
