// The role of a rotation stage: one axis that turns.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/roles/stage_axis.h"
#include "devices/time/clock.h"
#include "devices/time/identity.h"

namespace vitreo {

struct RotationStageInfo {
  Identity identity;
  StageAxis axis;  ///< rad, rad/s; an axis that turns without end has an infinite travel
};

/// As Stage, with one angle as its position.
class RotationStage {
 public:
  virtual ~RotationStage() = default;
  virtual const RotationStageInfo& info() const = 0;
  virtual double position() = 0;  ///< rad, from the stage's own origin; full turns are kept
  /// Sets off for `target`, rad, at `speed`, rad/s, and returns; as Stage::start.
  virtual void start(double target, double speed) = 0;
  virtual bool moving() = 0;
  virtual void wait(Time timeout) = 0;
  virtual void home(Time timeout) = 0;
  virtual void stop() = 0;
  virtual void make_safe() = 0;
};

/// Turns and waits until it is there; whatever breaks the wait off stops the stage.
void move_to(RotationStage& stage, double target, double speed, Time timeout, Clock& clock);

}  // namespace vitreo
