// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/pololu_tic/emulator.h"

#include "devices/instruments/pololu_tic/wire.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace vitreo::pololu_tic {
namespace {

using namespace std::chrono_literals;
/// Of the integration.
constexpr Time kStep = 1ms;
/// exit_safe_start clears the violation for this time, unless the state is normal by then.
constexpr Time kSafeStartGrace = 200ms;
/// V: of the motor's supply.
constexpr double kLowVoltage = 8;
/// s after which nothing of a motion can be left.
constexpr double kTwoSecondsAtRest = 2;
/// They de-energize the motor; the others only stop it.
constexpr std::uint16_t kHardErrors =
    kIntentionallyDeEnergized | kMotorDriverError | kLowVin | kKillSwitch;

enum class Planning { off, position, velocity };
enum class Homing { no, approaching, leaving };

/// Of a controller whose switches are wired and configured, as its model of the travel has them.
std::vector<std::uint8_t> with_limit_switches() {
  std::vector<std::uint8_t> settings(kSettingsSize, 0);
  settings[kLimitSwitchForwardMap] = settings[kLimitSwitchReverseMap] = 1;
  return settings;
}

/// It has no thread: its motion is integrated up to the present at each call. Two positions differ:
/// motor_, the truth, and the controller's counter, motor_ - zero_.
class EmulatedTic final : public Emulator {
 public:
  // The values of reported_ are those of a new controller, which a driver must not rely on.
  EmulatedTic(const EmulatorSettings& settings, const Clock& clock)
      : clock_(clock), given_(settings) {
    identity_ = {kVendor, settings.product, 0x0106, settings.serial, "Pololu Corporation",
                 "Tic",   "emulated"};
    settings_bytes_[kCommandTimeoutSetting] =
        static_cast<std::uint8_t>(settings.command_timeout_ms & 0xFF);
    settings_bytes_[kCommandTimeoutSetting + 1] =
        static_cast<std::uint8_t>(settings.command_timeout_ms >> 8);
    settings_bytes_[kSoftErrorResponse] = settings.soft_error_response;
    vin_ = settings.vin;
    now_ = clock.now();
    power_up();
    uncertain_ = !settings.position_known;
    zero_ = -settings.position;
  }

  const UsbIdentity& identity() const override { return identity_; }

  // Brought up to the present first, so that a command acts on the state of its own moment.
  // Nothing: a stall, as of a request that is not known.
  std::optional<std::vector<std::uint8_t>> control(const UsbSetup& setup,
                                                   std::span<const std::uint8_t>,
                                                   std::uint16_t length) override {
    advance();
    if (const auto read = decode_read(setup, length)) return answer(*read);
    const auto command = decode_command(setup);
    if (!command) return std::nullopt;
    if (feeds_the_timeout(command->code)) {
      fed_ = now_;
      errors_ &= static_cast<std::uint16_t>(~kCommandTimeout);
    }
    obey(*command);
    update_state();
    return std::vector<std::uint8_t>{};
  }

  double motor_usteps() override { return advance(), motor_; }
  bool moving() override { return advance(), speed_ != 0; }
  bool energized() override { return advance(), is_energized(); }
  // Motor and zero move alike, so the counter, their difference, does not show it.
  void slip(std::int64_t usteps) override {
    advance();
    motor_ += static_cast<double>(usteps);
    zero_ += static_cast<double>(usteps);
  }
  void power_cycle() override {
    advance();
    halt();
    zero_ = motor_;
    target_ = 0;
    target_speed_ = 0;
    power_up();
  }
  void set_vin(double volts) override {
    advance();
    vin_ = volts;
    update_state();
  }
  void set_jammed(bool jammed) override {
    advance();
    jammed_ = jammed;
  }
  void set_kill_switch(bool pressed) override {
    advance();
    killed_ = pressed;
    update_state();
  }

 private:
  /// What it takes from its settings when it starts.
  void power_up() {
    reported_ = {};
    reported_.step_mode = given_.step_mode;
    reported_.max_speed = 2000000;
    reported_.max_acceleration = reported_.max_deceleration = 40000;
    errors_ = kIntentionallyDeEnergized | kSafeStartViolation;
    state_ = OperationState::de_energized;
    safe_start_left_ = {};
    uncertain_ = true;
    fed_ = now_;
    update_state();
  }
  std::optional<std::vector<std::uint8_t>> answer(const Read& read) {
    std::vector<std::uint8_t> from =
        read.code == Code::get_variable ? encode_variables(variables()) : settings_bytes_;
    if (read.offset >= from.size()) return std::nullopt;
    from.erase(from.begin(), from.begin() + read.offset);
    if (from.size() > read.length) from.resize(read.length);
    return from;
  }
  // The counter is what the controller believes; where the motor is, only the emulator's owner can
  // ask.
  Variables variables() const {
    Variables v = reported_;
    v.state = state_;
    v.energized = is_energized();
    v.position_uncertain = uncertain_;
    v.reverse_limit = motor_ <= static_cast<double>(given_.home_usteps) && given_.home_switch_works;
    v.homing = homing_ != Homing::no;
    v.error_status = errors_;
    v.target_position = target_;
    v.current_position = static_cast<std::int32_t>(std::lround(motor_ - zero_));
    v.current_velocity = static_cast<std::int32_t>(std::lround(speed_ * 1e4));
    v.vin_millivolts = static_cast<std::uint16_t>(std::lround(vin_ * 1000));
    return v;
  }
  void obey(const Command& command);
  void configure(const Command& command);
  /// Abrupt.
  void halt() {
    speed_ = 0;
    planning_ = Planning::off;
    homing_ = Homing::no;
  }
  void reload() {
    halt();
    errors_ |= kSafeStartViolation;
  }
  bool is_energized() const {
    return (errors_ & kHardErrors) == 0 && state_ != OperationState::reset;
  }
  void update_state();
  void advance();
  void step(double dt);
  double wanted_speed(double dt) const;
  double homing_speed() const;
  void follow_the_switch();

  const Clock& clock_;
  const EmulatorSettings given_;
  UsbIdentity identity_;
  std::vector<std::uint8_t> settings_bytes_ = with_limit_switches();
  Variables reported_;  // the part that commands set and reads show
  std::uint16_t errors_ = kIntentionallyDeEnergized | kSafeStartViolation;
  OperationState state_ = OperationState::de_energized;
  bool uncertain_ = true;
  bool jammed_ = false;
  bool killed_ = false;
  double vin_ = 0;          // V
  Time now_{};              // up to which the motion is integrated
  Time fed_{};              // the last command that feeds the timeout
  Time safe_start_left_{};  // the last exit from safe start
  double motor_ = 0;        // usteps
  double zero_ = 0;         // usteps: where the counter is 0
  double speed_ = 0;        // usteps/s
  Planning planning_ = Planning::off;
  Homing homing_ = Homing::no;
  bool homing_forward_ = false;
  std::int32_t target_ = 0;
  double target_speed_ = 0;
};

/// Commands change what the motion aims at; step() does the motion. What marks the position as
/// uncertain is Pololu's list: halt_and_hold, go_home, de_energize.
void EmulatedTic::obey(const Command& command) {
  switch (command.code) {
    case Code::set_target_position:
      planning_ = Planning::position;
      homing_ = Homing::no;
      target_ = command.argument;
      break;
    case Code::set_target_velocity:
      planning_ = Planning::velocity;
      homing_ = Homing::no;
      target_speed_ = command.argument / 1e4;
      break;
    case Code::halt_and_set_position:
      halt();
      zero_ = motor_ - command.argument;
      uncertain_ = false;
      break;
    case Code::halt_and_hold:
      halt();
      uncertain_ = true;
      break;
    case Code::go_home:
      homing_ = Homing::approaching;
      planning_ = Planning::off;
      homing_forward_ = command.argument == 1;
      uncertain_ = true;
      break;
    case Code::de_energize:
      halt();
      errors_ |= kIntentionallyDeEnergized;
      uncertain_ = true;
      break;
    case Code::energize:
      errors_ &= static_cast<std::uint16_t>(~kIntentionallyDeEnergized);
      break;
    case Code::exit_safe_start:
      errors_ &= static_cast<std::uint16_t>(~kSafeStartViolation);
      safe_start_left_ = now_;
      break;
    case Code::enter_safe_start:
      errors_ |= kSafeStartViolation;
      break;
    case Code::reset:
    case Code::reinitialize:
      reload();
      break;
    default:
      configure(command);
      break;
  }
}

/// Settings of the motion, and those that are kept.
void EmulatedTic::configure(const Command& command) {
  switch (command.code) {
    case Code::set_max_speed:
      reported_.max_speed = static_cast<std::uint32_t>(command.argument);
      break;
    case Code::set_max_acceleration:
      reported_.max_acceleration = static_cast<std::uint32_t>(command.argument);
      break;
    case Code::set_max_deceleration:
      reported_.max_deceleration = static_cast<std::uint32_t>(command.argument);
      break;
    case Code::set_step_mode:
      reported_.step_mode = static_cast<std::uint8_t>(command.argument);
      break;
    case Code::set_current_limit:
      reported_.current_limit = static_cast<std::uint8_t>(command.argument);
      break;
    case Code::set_setting:
      if (command.setting < kSettingsSize)
        settings_bytes_[command.setting] = static_cast<std::uint8_t>(command.argument);
      break;
    default:  // what only feeds the timeout, or clears what this emulator does not have
      break;
  }
}

/// The state follows from the errors: hard ones de-energize, soft ones stop. Leaving the normal
/// state sets the safe-start violation, which lasts until the next exit_safe_start.
void EmulatedTic::update_state() {
  const auto set = [this](std::uint16_t error, bool on) {
    errors_ = static_cast<std::uint16_t>(on ? errors_ | error : errors_ & ~error);
  };
  set(kLowVin, vin_ < kLowVoltage);
  set(kKillSwitch, killed_);
  const bool was_normal = state_ == OperationState::normal;
  if ((errors_ & kHardErrors) != 0) {
    if (state_ != OperationState::de_energized) halt();
    if (vin_ < kLowVoltage) uncertain_ = true;
    state_ = OperationState::de_energized;
  } else {
    state_ = errors_ != 0 ? OperationState::soft_error : OperationState::normal;
  }
  // A virtual clock begins at 0, where no exit from safe start can have been.
  const bool in_grace =
      now_ - safe_start_left_ <= kSafeStartGrace && safe_start_left_ != Time::zero();
  if (state_ == OperationState::normal) return;
  if ((was_normal || !in_grace) && settings_bytes_[kDisableSafeStart] == 0) {
    errors_ |= kSafeStartViolation;
    if (state_ == OperationState::normal) state_ = OperationState::soft_error;
  }
}

/// Integrates up to the clock's time, in steps of kStep. A motor at rest takes one long step up to
/// a second before the present: only the command timeout can happen meanwhile.
void EmulatedTic::advance() {
  const Time until = clock_.now();
  while (now_ < until) {
    const bool at_rest =
        speed_ == 0 &&
        (state_ != OperationState::normal ||
         (planning_ == Planning::off && homing_ == Homing::no) ||
         (planning_ == Planning::position && std::lround(motor_ - zero_) == target_) ||
         (planning_ == Planning::velocity && target_speed_ == 0));
    Time step_length = std::min(kStep, until - now_);
    if (at_rest && to_seconds(until - now_) > kTwoSecondsAtRest) step_length = until - now_ - 1s;
    now_ += step_length;
    const Time timeout = std::chrono::milliseconds(
        settings_bytes_[kCommandTimeoutSetting] | settings_bytes_[kCommandTimeoutSetting + 1] << 8);
    if (timeout > Time::zero() && now_ - fed_ > timeout) errors_ |= kCommandTimeout;
    update_state();
    if (at_rest) continue;
    // A jammed motor stands, and the counter goes on.
    const double before = motor_;
    step(to_seconds(step_length));
    if (!jammed_) continue;
    zero_ -= motor_ - before;
    motor_ = before;
  }
}

/// usteps/s: fast to the switch, slowly off it.
double EmulatedTic::homing_speed() const {
  return reported_.max_speed / 1e4 / (homing_ == Homing::approaching ? 4 : 16);
}

/// usteps/s that the motor accelerates or decelerates to.
double EmulatedTic::wanted_speed(double dt) const {
  if (state_ != OperationState::normal) return 0;  // the soft error response: decelerate to hold
  if (homing_ != Homing::no) {
    const bool forward = homing_forward_ == (homing_ == Homing::approaching);
    return forward ? homing_speed() : -homing_speed();
  }
  const double limit = reported_.max_speed / 1e4;
  if (planning_ == Planning::velocity) return std::clamp(target_speed_, -limit, limit);
  if (planning_ == Planning::off) return 0;
  // v = sqrt(2 a s): the fastest from which it still stops at the target; and s / dt, so that the
  // last step does not pass it.
  const double way = zero_ + target_ - motor_;
  const double slow_enough = std::sqrt(2 * reported_.max_deceleration / 100. * std::abs(way));
  return std::copysign(std::min({limit, slow_enough, std::abs(way) / dt}), way);
}

/// Explicit Euler: v by at most a dt towards the wanted speed, then x by v dt.
void EmulatedTic::step(double dt) {
  const double wanted = wanted_speed(dt);
  const bool speeds_up = std::abs(wanted) > std::abs(speed_);
  const double change =
      (speeds_up ? reported_.max_acceleration : reported_.max_deceleration) / 100. * dt;
  const bool abrupt =
      state_ != OperationState::normal && settings_bytes_[kSoftErrorResponse] != kDecelerateToHold;
  speed_ = abrupt ? 0 : std::clamp(wanted, speed_ - change, speed_ + change);
  if (abrupt && settings_bytes_[kSoftErrorResponse] <= 1) uncertain_ = true;
  motor_ += speed_ * dt;
  // Arrived: within half a microstep, and slow enough to stop.
  if (planning_ == Planning::position && state_ == OperationState::normal &&
      std::abs(zero_ + target_ - motor_) < 0.5 && std::abs(speed_) <= 4 * change) {
    motor_ = zero_ + target_;
    speed_ = 0;
  }
  if (homing_ != Homing::no) follow_the_switch();
}

/// Homing: to the switch, back off it, and 0 where it is just released.
void EmulatedTic::follow_the_switch() {
  if (!given_.home_switch_works || state_ != OperationState::normal) return;
  const double from_switch =
      (motor_ - static_cast<double>(given_.home_usteps)) * (homing_forward_ ? -1 : 1);
  if (homing_ == Homing::approaching && from_switch <= 0) homing_ = Homing::leaving;
  if (homing_ != Homing::leaving || from_switch <= 0) return;
  halt();
  motor_ = zero_ = static_cast<double>(given_.home_usteps);  // where the switch is just released
  target_ = 0;
  uncertain_ = false;
}

}  // namespace

std::unique_ptr<Emulator> make_emulator(const EmulatorSettings& settings, const Clock& clock) {
  return std::make_unique<EmulatedTic>(settings, clock);
}

}  // namespace vitreo::pololu_tic
