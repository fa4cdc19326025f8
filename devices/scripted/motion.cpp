// Stages, rotation stages and lens movers from one Lua file.
// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/stage_driver.h"
#include "devices/scripted/exchange.h"
#include "devices/scripted/instrument.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace vitreo::scripted {
namespace {

/// Between two questions whether it stands still, and how long it may take to.
constexpr Time kStandstillLook = std::chrono::milliseconds(10);
constexpr Time kHalt = std::chrono::seconds(3);

/// The exchanges of devices/instruments/stage_driver.h, each a function of the file; positions are
/// in the declared unit there.
class ScriptedStage final : public StageProtocol {
 public:
  explicit ScriptedStage(Opening opening)
      : StageProtocol(std::move(opening.link), opening.name, opening.clock),
        loaded_(std::move(opening.loaded)),
        exchange_(loaded_, dialogue) {}

  StageInfo configure() override {
    StageInfo info;
    info.identity = exchange_.begin();
    for (const AxisDeclaration& axis : loaded_.declaration.axes)
      info.axes.push_back({axis.name, axis.travel_min, axis.travel_max, axis.max_speed, axis.speed,
                           axis.resolution});
    // A stage that still moves from an earlier program would be taken for one that stands.
    halt();
    return info;
  }

  std::vector<double> position() override {
    const auto said = call("position");
    std::vector<double> list;
    if (const auto* one = said ? std::get_if<double>(&*said) : nullptr) list = {*one};
    if (const auto* all = said ? std::get_if<std::vector<double>>(&*said) : nullptr) list = *all;
    const auto& axes = loaded_.declaration.axes;
    if (list.size() != axes.size())
      fail(DeviceErrorKind::protocol, "its driver gave " + std::to_string(list.size()) +
                                          " positions of " + std::to_string(axes.size()) + " axes");
    for (std::size_t i = 0; i < list.size(); ++i) list[i] = axes[i].unit.to_si(list[i]);
    return list;
  }

  void set_off(std::span<const double> target, double speed) override {
    const auto& axes = loaded_.declaration.axes;
    target_.assign(target.begin(), target.end());  // first: one that is refused is looked at too
    if (loaded_.declaration.functions.contains("homed") && !flag("homed"))
      fail(DeviceErrorKind::refused, "it wants home() first");
    std::vector<double> declared;
    for (std::size_t i = 0; i < target.size(); ++i)
      declared.push_back(axes[i].unit.from_si(target[i]));
    // A speed in the unit of the first axis: mm/s where positions are in mm.
    // A factor and no offset: speeds are differences of positions.
    call("set_off", {declared, speed / axes.front().unit.factor});
    commanded();
  }

  void set_off_home() override {
    if (!loaded_.declaration.functions.contains("home"))
      fail(DeviceErrorKind::refused, "it has no reference");
    call("home");
    commanded();
  }

  // Some say that they stand until the motion has begun: only what was seen to move has arrived.
  bool busy() override {
    const bool moves = flag("moving");
    if (moves) starts_by_ = Time::min();
    return moves || clock().now() < starts_by_;
  }

  // Twice the resolution: what is read back is rounded, and so was the target.
  void check_arrival(bool homing) override {
    if (homing) return;
    const std::vector<double> at = position();
    for (std::size_t i = 0; i < at.size(); ++i)
      if (std::abs(at[i] - target_[i]) > 2 * loaded_.declaration.axes[i].resolution)
        fail(DeviceErrorKind::refused,
             "axis " + loaded_.declaration.axes[i].name + " ended at " +
                 position_text(at[i], loaded_.declaration.axes[i].unit.si) + ", not at " +
                 position_text(target_[i], loaded_.declaration.axes[i].unit.si));
  }

  void halt() override {
    call("halt");
    starts_by_ = Time::min();
    const Time deadline = later(clock().now(), kHalt);
    while (flag("moving")) {
      if (clock().now() >= deadline) fail(DeviceErrorKind::timeout, "it does not stop");
      clock().sleep_for(kStandstillLook);
    }
  }

  void send_halt() override {
    try {
      call("halt");
    } catch (const DeviceError&) {  // all that can be done was tried
    }
  }

 private:
  std::optional<QuantityValue> call(const char* function,
                                    const std::vector<QuantityValue>& arguments = {}) {
    return exchange_.call(loaded_.declaration.functions.at(function), arguments);
  }
  bool flag(const char* function) {
    const auto said = call(function);
    const bool* const value = said ? std::get_if<bool>(&*said) : nullptr;
    if (value == nullptr)
      fail(DeviceErrorKind::protocol,
           std::string("its driver's ") + function + " gave neither true nor false");
    return *value;
  }

  void commanded() { starts_by_ = later(clock().now(), loaded_.declaration.starts_within); }

  Loaded loaded_;
  Exchange exchange_;
  std::vector<double> target_;
  Time starts_by_ = Time::min();  // until then it may say that it stands, and not have begun
};

/// A stage of one axis as the lens' motor.
class ScriptedLensMover final : public LensMover {
 public:
  ScriptedLensMover(std::unique_ptr<Stage> stage, Clock& clock, bool needs_home)
      : stage_(std::move(stage)), clock_(clock), homed_(!needs_home) {}
  std::string identity() const override { return to_string(stage_->info().identity); }
  double position() const override { return stage_->position().front(); }
  void move_to(double position, Time timeout) override {
    if (!(position >= travel_min() && position <= travel_max()))  // nor what is no number
      throw DeviceError(DeviceErrorKind::out_of_range, "lens_mover", "is beyond its travel");
    if (!homed_) throw DeviceError(DeviceErrorKind::refused, "lens_mover", "it wants home() first");
    if (!std::isfinite(position))
      throw DeviceError(DeviceErrorKind::out_of_range, "lens_mover",
                        "a position that is not a number is outside its travel");
    vitreo::move_to(*stage_, {&position, 1}, axis().speed, timeout, clock_);
  }
  double travel_min() const override { return axis().travel_min; }
  double travel_max() const override { return axis().travel_max; }
  bool homed() const override { return homed_; }
  void home(Time timeout) override {
    stage_->home(timeout);
    homed_ = true;
  }
  void make_safe() override { stage_->make_safe(); }

 private:
  const StageAxis& axis() const { return stage_->info().axes.front(); }
  std::unique_ptr<Stage> stage_;
  Clock& clock_;
  bool homed_;
};

}  // namespace

std::unique_ptr<Stage> open_stage(Opening opening) {
  return make_stage(std::make_unique<ScriptedStage>(std::move(opening)));
}

std::unique_ptr<RotationStage> open_rotation_stage(Opening opening) {
  return make_rotation_stage(std::make_unique<ScriptedStage>(std::move(opening)));
}

// A motor that counts its steps has lost its place with its power: it is homed each time.
std::unique_ptr<LensMover> open_lens_mover(Opening opening) {
  Clock& clock = opening.clock;
  return std::make_unique<ScriptedLensMover>(open_stage(std::move(opening)), clock, true);
}

}  // namespace vitreo::scripted
