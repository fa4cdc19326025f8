// Driver of a stage: the roles Stage and RotationStage on top of the few exchanges that differ from
// instrument to instrument. One motion at a time, waiting, stopping, reopening after a lost link.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/byte_link.h"
#include "devices/links/dialogue.h"
#include "devices/roles/rotation_stage.h"
#include "devices/roles/stage.h"
#include "devices/time/clock.h"
#include "devices/time/error.h"

#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

namespace vitreo {

/// The exchanges of one kind of instrument. All are called during a Turn of the dialogue, so a stop
/// cannot break them off; all throw DeviceError.
class StageProtocol {
 public:
  StageProtocol(std::unique_ptr<ByteLink> link, const std::string& name, Clock& clock)
      : dialogue(std::move(link), name, clock) {}
  virtual ~StageProtocol() = default;
  /// All that a fresh link needs: identity, that it stands still, and all settings, read back.
  /// Moves nothing.
  virtual StageInfo configure() = 0;
  /// m or rad, one per axis.
  virtual std::vector<double> position() = 0;
  /// The target was checked. Returns when the motion has begun.
  virtual void set_off(std::span<const double> target, double speed) = 0;
  virtual void set_off_home() = 0;
  /// Whether the motion goes on; does not wait for its end. Throws when it has failed.
  virtual bool busy() = 0;
  /// After a motion: throws DeviceError{refused} when it ended elsewhere than at its target.
  virtual void check_arrival(bool homing) = 0;
  /// Stops it, and returns when it stands still.
  virtual void halt() = 0;
  /// At the end, standing still: puts back what it keeps for good and had otherwise before.
  virtual void leave() {}
  /// Sends the stop and waits for nothing: for an instrument that answers no more.
  virtual void send_halt() = 0;

  Dialogue dialogue;

 protected:
  Clock& clock() const { return dialogue.clock(); }
  [[noreturn]] void fail(DeviceErrorKind kind, const std::string& what) const {
    dialogue.fail(kind, what);
  }
};

/// Base for controllers of three axes that answer a motion with one byte at its end, and to which
/// nothing but an interrupt may be sent until then (Sutter MP-285 and MPC-200). The position during
/// a motion is an estimate: a straight path at constant speed.
class SilentStageProtocol : public StageProtocol {
 public:
  using Usteps = std::array<std::int32_t, 3>;  ///< x, y, z
  struct Traits {
    double ustep = 0;          ///< m
    int usteps_per_um = 1;     ///< of messages
    int tolerance = 0;         ///< usteps: how far from its target an axis may end
    Time silence{};            ///< after which nothing more of an answer comes
    double reply_timeout = 0;  ///< s, of everything but a motion
    std::uint8_t end = 0x0D;   ///< the answer to a motion that has ended well
    std::uint8_t interrupt = 0x03;
  };
  SilentStageProtocol(std::unique_ptr<ByteLink> link, const std::string& name, Clock& clock,
                      const Traits& traits)
      : StageProtocol(std::move(link), name, clock), traits_(traits) {}
  std::vector<double> position() override;
  bool busy() override;
  void check_arrival(bool homing) override;
  void halt() override;
  void send_halt() override;

 protected:
  /// Asks for the position; only while it stands.
  virtual Usteps where() = 0;
  /// After an answer that did not come or could not be read: interrupts whatever it does and
  /// discards everything it may still send.
  virtual void resynchronize() = 0;
  /// Throws for an answer to a motion other than Traits::end.
  [[noreturn]] virtual void fail_for(std::uint8_t answer) const = 0;

  Time reply_deadline() const { return later(clock().now(), from_seconds(traits_.reply_timeout)); }
  /// Sets target_ (from m) and returns the longest way of an axis, in usteps.
  std::int32_t aim(std::span<const double> target);
  /// The motion to target_ was sent; it ends within `longest`.
  void begin(Time longest);

  bool unsure_ = false;  ///< an exchange was broken off: part of an answer may still come
  bool moving_ = false;
  Usteps from_{};
  Usteps target_{};
  double speed_ = 0;  ///< m/s, of the motion under way

 private:
  const Traits traits_;
  Time begun_{};
  Time deadline_{};
};

/// Configures the instrument and plays the role. Destruction stops it.
std::unique_ptr<Stage> make_stage(std::unique_ptr<StageProtocol> protocol);
/// The same with the one axis of `protocol`, in rad.
std::unique_ptr<RotationStage> make_rotation_stage(std::unique_ptr<StageProtocol> protocol);

}  // namespace vitreo
