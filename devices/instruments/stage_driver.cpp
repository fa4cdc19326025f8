// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/stage_driver.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <exception>
#include <stdexcept>
#include <utility>

namespace vitreo {
namespace {

/// Between two questions whether a motion goes on.
constexpr Time kPoll = std::chrono::milliseconds(20);

/// All of a stage's driver but its role. Each public call is one or more Turns of the dialogue, so
/// that tasks may share a stage: one waits while another asks for the position or stops it.
class Motion {
 public:
  Motion(std::unique_ptr<StageProtocol> protocol, const char* unit)
      : protocol_(std::move(protocol)), dialogue_(protocol_->dialogue), unit_(unit) {
    const Dialogue::Turn turn(dialogue_);
    info_ = dialogue_.opening([this] { return protocol_->configure(); });
  }
  // A link that was lost is not opened again here, only to stop what cannot be reached.
  ~Motion() {
    try {
      if (!dialogue_.lost()) stop();
      const Dialogue::Turn turn(dialogue_);
      if (!dialogue_.lost()) protocol_->leave();
    } catch (...) {  // a destructor cannot report it
    }
  }
  Motion(const Motion&) = delete;
  Motion& operator=(const Motion&) = delete;

  const StageInfo& info() const { return info_; }

  /// Asking opens a lost link; nothing is set moving by that.
  std::vector<double> position() {
    const Dialogue::Turn turn(dialogue_);
    be_open();
    return protocol_->position();
  }

  /// Limits are checked before the instrument is asked anything.
  /// A motion that is under way refuses another one, see begin().
  void start(std::span<const double> target, double speed) {
    check_motion(info_.axes, target, speed, dialogue_.device(), unit_);
    const Dialogue::Turn turn(dialogue_);
    begin(false);
    protocol_->set_off(target, speed);
  }

  bool moving() {
    const Dialogue::Turn turn(dialogue_);
    be_open();
    return poll_motion();
  }

  /// Polls, with the dialogue free for other tasks in between.
  void wait(Time timeout) {
    const Time deadline = later(clock().now(), timeout);
    for (;;) {
      {
        const Dialogue::Turn turn(dialogue_);
        if (!poll_motion()) {
          if (const auto ending = std::exchange(ending_, nullptr)) std::rethrow_exception(ending);
          return;
        }
        if (clock().now() >= deadline) give_up();
      }
      clock().sleep_until(std::min(deadline, later(clock().now(), kPoll)));
    }
  }

  /// Nothing to check against the limits: the instrument chooses target and speed.
  /// wait() is called without the Turn, which another task may need to stop the homing.
  void home(Time timeout) {
    {
      const Dialogue::Turn turn(dialogue_);
      begin(true);
      protocol_->set_off_home();
    }
    wait(timeout);
  }

  /// Whether or not a motion is known of: the stage may have been set moving at its panel.
  /// The task in wait() is told first, so that it does not take the halt for an arrival.
  void stop() {
    const Dialogue::Turn turn(dialogue_);
    be_open();
    if (moving_) end(DeviceErrorKind::refused, "it was stopped on its way");
    protocol_->halt();
  }

 private:
  Clock& clock() const { return dialogue_.clock(); }

  /// One motion at a time; the ending of the last one is dropped, for it was not waited for.
  void begin(bool homing) {
    be_open();
    if (poll_motion()) dialogue_.fail(DeviceErrorKind::refused, "it is still moving");
    ending_ = nullptr;
    moving_ = true;  // should the exchange fail half-way, it may be
    homing_ = homing;
  }

  /// Whether the motion goes on; when it does not, ending_ is how it ended, or null at its target.
  /// An exception is kept for wait(), for poll_motion() is also called by tasks that did not start
  /// the motion.
  bool poll_motion() {
    if (!moving_) return false;
    try {
      if (protocol_->busy()) return true;
      moving_ = false;
      protocol_->check_arrival(homing_);
    } catch (const DeviceError& error) {
      ending_ = std::current_exception();
      moving_ = false;
      // Whatever the fault is, the stage may still move; over a lost link nothing can be sent.
      if (error.kind != DeviceErrorKind::lost) protocol_->send_halt();
    }
    return false;
  }

  /// For a task that is in wait(), or comes to it.
  void end(DeviceErrorKind kind, const char* how) {
    moving_ = false;
    ending_ = std::make_exception_ptr(DeviceError(kind, dialogue_.device(), how));
  }

  /// The deadline of wait(): the stage is stopped before the error is thrown.
  /// No ending is kept: the caller has it by the exception.
  [[noreturn]] void give_up() {
    moving_ = false;
    protocol_->halt();
    dialogue_.fail(DeviceErrorKind::timeout, homing_ ? "not home in time" : "not there in time");
  }

  /// After a lost link: opens it again, where it can be. What was set off is dropped; the halt is
  /// part of configure().
  void be_open() {
    if (dialogue_.lost() && moving_) end(DeviceErrorKind::lost, "the link was lost while it moved");
    dialogue_.be_open(info_.identity, [this] { return protocol_->configure().identity; });
  }

  std::unique_ptr<StageProtocol> protocol_;
  Dialogue& dialogue_;
  const char* const unit_;
  StageInfo info_;
  bool moving_ = false;
  bool homing_ = false;
  // How the last motion ended, unless well, until wait() has thrown it.
  std::exception_ptr ending_;
};

/// A Motion in the role of a Stage: make_safe() is to stand still.
class DrivenStage final : public Stage {
 public:
  explicit DrivenStage(std::unique_ptr<StageProtocol> protocol)
      : motion_(std::move(protocol), "m") {}
  const StageInfo& info() const override { return motion_.info(); }
  std::vector<double> position() override { return motion_.position(); }
  void start(std::span<const double> target, double speed) override {
    motion_.start(target, speed);
  }
  bool moving() override { return motion_.moving(); }
  void wait(Time timeout) override { motion_.wait(timeout); }
  void home(Time timeout) override { motion_.home(timeout); }
  void stop() override { motion_.stop(); }
  void make_safe() override { motion_.stop(); }

 private:
  Motion motion_;
};

/// A Motion of one axis in the role of a RotationStage.
class DrivenRotationStage final : public RotationStage {
 public:
  explicit DrivenRotationStage(std::unique_ptr<StageProtocol> protocol)
      : motion_(std::move(protocol), "rad") {
    if (motion_.info().axes.size() != 1)
      throw std::invalid_argument("axes: a rotation stage has one");
    info_ = {motion_.info().identity, motion_.info().axes.front()};
  }
  const RotationStageInfo& info() const override { return info_; }
  double position() override { return motion_.position().front(); }
  void start(double target, double speed) override { motion_.start({&target, 1}, speed); }
  bool moving() override { return motion_.moving(); }
  void wait(Time timeout) override { motion_.wait(timeout); }
  void home(Time timeout) override { motion_.home(timeout); }
  void stop() override { motion_.stop(); }
  void make_safe() override { motion_.stop(); }

 private:
  Motion motion_;
  RotationStageInfo info_;
};

}  // namespace

// Rounded to whole microsteps of the instrument.
std::int32_t SilentStageProtocol::aim(std::span<const double> target) {
  std::int32_t longest = 0;
  for (std::size_t i = 0; i < target_.size(); ++i) {
    target_[i] = static_cast<std::int32_t>(std::lround(target[i] / traits_.ustep));
    longest = std::max(longest, std::abs(target_[i] - from_[i]));
  }
  return longest;
}

// The deadline stands for the answer that does not come: nothing may be asked before.
void SilentStageProtocol::begin(Time longest) {
  begun_ = clock().now();
  deadline_ = later(begun_, longest);
  moving_ = true;
}

/// While it moves: from + s (target - from), where s grows from 0 to 1 at the speed of the axis
/// with the longest way. Any byte on the wire would end the motion.
std::vector<double> SilentStageProtocol::position() {
  std::vector<double> position(target_.size());
  if (!moving_) {
    const Usteps at = where();
    std::transform(at.begin(), at.end(), position.begin(),
                   [this](std::int32_t axis) { return axis * traits_.ustep; });
    return position;
  }
  double longest = 0;
  for (std::size_t i = 0; i < target_.size(); ++i)
    longest = std::max(longest, std::abs(target_[i] - from_[i]) * traits_.ustep);
  const double part =
      longest > 0 ? std::min(1., to_seconds(clock().now() - begun_) * speed_ / longest) : 1;
  for (std::size_t i = 0; i < target_.size(); ++i)
    position[i] = (from_[i] + part * (target_[i] - from_[i])) * traits_.ustep;
  return position;
}

/// Listens for the byte at the end of the motion, and sends nothing.
/// Past the deadline the line counts as unsure, for the answer may still come.
bool SilentStageProtocol::busy() {
  if (!moving_) return false;
  const auto answer = dialogue.next(clock().now());
  if (!answer && clock().now() < deadline_) return true;
  moving_ = false;
  if (!answer)
    fail(DeviceErrorKind::timeout,
         dialogue.description() + ": it was silent when its motion should have ended");
  if (*answer != traits_.end) fail_for(*answer);
  unsure_ = false;
  return false;
}

// The byte at the motion's end says that it ended, not where.
void SilentStageProtocol::check_arrival(bool) {
  const Usteps at = where();
  for (std::size_t i = 0; i < at.size(); ++i)
    if (std::abs(at[i] - target_[i]) > traits_.tolerance)
      fail(DeviceErrorKind::refused,
           std::string("axis ") + "xyz"[i] + ": it stands " +
               std::to_string((at[i] - target_[i]) / traits_.usteps_per_um) +
               " um from its target");
}

/// The interrupt is the only byte that may be sent during a motion. Whether the motion's own answer
/// comes as well is not known, so resynchronize() reads until the line is silent. Two equal
/// positions afterwards show that it stands.
void SilentStageProtocol::halt() {
  if (!moving_ && !unsure_) return;
  resynchronize();
  const Usteps first = where();
  clock().sleep_for(traits_.silence);
  if (where() != first) fail(DeviceErrorKind::timeout, "it does not stop");
}

// Unsure from here on: the answer to the interrupt is left on the line.
void SilentStageProtocol::send_halt() {
  unsure_ = true;
  try {
    dialogue.send(std::span(&traits_.interrupt, 1));
  } catch (const DeviceError&) {  // the first error says more
  }
}

std::unique_ptr<Stage> make_stage(std::unique_ptr<StageProtocol> protocol) {
  return std::make_unique<DrivenStage>(std::move(protocol));
}

std::unique_ptr<RotationStage> make_rotation_stage(std::unique_ptr<StageProtocol> protocol) {
  return std::make_unique<DrivenRotationStage>(std::move(protocol));
}

}  // namespace vitreo
