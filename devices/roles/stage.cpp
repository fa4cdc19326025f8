// Moving and waiting in one, for stages that turn and stages that do not.
// SPDX-License-Identifier: Apache-2.0
#include "devices/roles/stage.h"

#include "devices/roles/rotation_stage.h"

#include <exception>

namespace vitreo {
namespace {

template <class AnyStage>
void wait_or_stop(AnyStage& stage, Time timeout, Clock& clock) {
  try {
    stage.wait(timeout);
  } catch (...) {
    const auto first = std::current_exception();
    const StopShield shield(clock);
    try {
      stage.stop();
    } catch (const std::exception&) {  // what broke the wait off says more
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

void turn_to(RotationStage& stage, double angle, double speed, Time timeout, Clock& clock) {
  stage.start(angle, speed);
  wait_or_stop(stage, timeout, clock);
}

}  // namespace vitreo
