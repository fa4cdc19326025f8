// What the drivers of all stages share: one motion at a time, waiting, stopping, and opening again
// after a lost link.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/byte_link.h"
#include "devices/links/dialogue.h"
#include "devices/roles/rotation_stage.h"
#include "devices/roles/stage.h"
#include "devices/time/clock.h"

#include <memory>
#include <span>
#include <string>
#include <vector>

namespace vitreo {

/// What differs from stage to stage: a few exchanges each. All are called during a Turn of the
/// dialogue, so a stop cannot break them off; all throw DeviceError.
class StageProtocol {
 public:
  StageProtocol(std::unique_ptr<ByteLink> link, const std::string& name, Clock& clock)
      : dialogue(std::move(link), name, clock) {}
  virtual ~StageProtocol() = default;
  /// All that a fresh link needs: who is there, that it stands still, and all settings, read back.
  /// Moves nothing.
  virtual StageInfo configure() = 0;
  virtual std::vector<double> position() = 0;
  /// The target was checked. Returns when the motion has begun.
  virtual void set_off(std::span<const double> target, double speed) = 0;
  virtual void set_off_home() = 0;
  /// Whether the motion goes on; asks without waiting for its end. Throws when it has failed.
  virtual bool busy() = 0;
  /// After a motion: throws DeviceError{refused} when it is not where it was to be.
  virtual void check_arrival(bool homing) = 0;
  /// Stops it, and returns when it stands still.
  virtual void halt() = 0;
  /// Says so and waits for nothing: for when it answers no more.
  virtual void tell_to_halt() = 0;

  Dialogue dialogue;
};

/// Configures the instrument and plays the role. Destruction stops it.
std::unique_ptr<Stage> make_stage(std::unique_ptr<StageProtocol> protocol);
/// The same with the one axis of `protocol`, in rad.
std::unique_ptr<RotationStage> make_rotation_stage(std::unique_ptr<StageProtocol> protocol);

}  // namespace vitreo
