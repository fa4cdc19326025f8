// The role of a stage: linear axes that carry a camera, a lens, an eye, a sensor.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/roles/stage_axis.h"
#include "devices/time/clock.h"
#include "devices/time/identity.h"

#include <span>
#include <vector>

namespace vitreo {

struct StageInfo {
  Identity identity;
  std::vector<StageAxis> axes;  ///< m, m/s
};

/// Every function that talks to the instrument throws DeviceError{lost, timeout, protocol}, and
/// Stopped. A stage never moves by itself: not when it is opened, not when a lost link comes back,
/// and a target that was not reached is dropped.
class Stage {
 public:
  virtual ~Stage() = default;
  virtual const StageInfo& info() const = 0;
  /// m, one per axis, from the stage's own origin. While it moves: an estimate where the instrument
  /// cannot be asked.
  virtual std::vector<double> position() = 0;
  /// Sets off for `target`, m, one per axis, at `speed`, m/s, of the axis with the longest way, and
  /// returns. Throws as check_motion() does, and DeviceError{refused} while it moves and where it
  /// wants home() first; then nothing is sent.
  virtual void start(std::span<const double> target, double speed) = 0;
  /// Whether the motion that was started goes on. How it ended, wait() reports.
  virtual bool moving() = 0;
  /// Until the motion has ended, at once when there is none. DeviceError{timeout}, and the stage is
  /// stopped; DeviceError{refused} when it was stopped, or ended anywhere but at its target.
  virtual void wait(Time timeout) = 0;
  /// Finds the reference of its positions by moving to it, at the instrument's own speed; waits.
  /// DeviceError{timeout}, and the stage is stopped; DeviceError{refused} where it has no
  /// reference.
  virtual void home(Time timeout) = 0;
  /// Returns when it stands still. A task that is in wait() gets DeviceError{refused}. Idempotent.
  virtual void stop() = 0;
  /// Stands still, whatever the state. Idempotent.
  virtual void make_safe() = 0;
};

/// Moves and waits until it is there; whatever breaks the wait off stops the stage.
void move_to(Stage& stage, std::span<const double> target, double speed, Time timeout,
             Clock& clock);

}  // namespace vitreo
