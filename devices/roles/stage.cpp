// SPDX-License-Identifier: Apache-2.0
#include "devices/roles/stage.h"

#include "devices/roles/rotation_stage.h"

#include <exception>

namespace vitreo {
namespace {

/// Whatever ends the wait early (a deadline, a stop of the task, a lost link) also stops the stage;
/// the stop of the stage itself cannot be broken off.
template <class AnyStage>
void wait_or_stop(AnyStage& stage, Time timeout, Clock& clock) {
  try {
    stage.wait(timeout);
  } catch (...) {
    const auto first = std::current_exception();
    const StopShield shield(clock);
    try {
      stage.stop();
    } catch (const std::exception&) {  // the error that ended the wait says more
    }
    std::rethrow_exception(first);
  }
}

}  // namespace

void move_to(Stage& stage, std::span<const double> target, double speed, Time timeout,
             Clock& clock) {
  stage.start(target, speed);
  wait_or_stop(stage, timeout, clock);
}

// As move_to() above, of one axis.
void move_to(RotationStage& stage, double target, double speed, Time timeout, Clock& clock) {
  stage.start(target, speed);
  wait_or_stop(stage, timeout, clock);
}

}  // namespace vitreo
