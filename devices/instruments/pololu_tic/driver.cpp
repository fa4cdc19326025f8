// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/pololu_tic/driver.h"

#include "devices/instruments/pololu_tic/wire.h"
#include "devices/links/printable.h"
#include "devices/time/error.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <limits>
#include <stdexcept>
#include <utility>

namespace vitreo::pololu_tic {
namespace {

using namespace std::chrono_literals;
/// Between two reads of the variables during a motion.
constexpr Time kPoll = 20ms;
/// Until the motor's coils have settled and the state is normal.
constexpr Time kEnergizing = 1s;
/// The controller may stall for 1500 ms while it writes its settings (Pololu's own library).
constexpr Time kSettingTimeout = 1600ms;
/// Speeds count usteps per 10000 s.
constexpr double kPerSpeed = 1e4;
/// Accelerations count usteps per 100 s^2.
constexpr double kPerAcceleration = 100;
/// Errors that energize and exit_safe_start clear; all others have a cause that lasts.
constexpr std::uint16_t kEndsByItself =
    kCommandTimeout | kSafeStartViolation | kIntentionallyDeEnergized;

std::string in_millimeters(double meters) {
  char text[32];
  std::snprintf(text, sizeof text, "%g mm", meters * 1e3);
  return text;
}

/// The bits of error_status in words, from bit 0.
/// The names are those of the user's guide, where a person looks them up.
std::string names_of(std::uint16_t errors) {
  static constexpr const char* kNames[] = {"intentionally de-energized",
                                           "motor driver error",
                                           "low supply voltage",
                                           "kill switch",
                                           "required input invalid",
                                           "serial error",
                                           "command timeout",
                                           "safe start violation",
                                           "error line high"};
  std::string text;
  for (int bit = 0; bit < 9; ++bit)
    if ((errors >> bit & 1) != 0) text += (text.empty() ? "" : ", ") + std::string(kNames[bit]);
  return text.empty() ? "no error named" : text;
}

// By the USB product number; six models share the protocol.
const char* model_of(std::uint16_t product) {
  switch (product) {
    case 0x00B3:
      return "T825";
    case 0x00B5:
      return "T834";
    case 0x00BD:
      return "T500";
    case 0x00C3:
      return "N825";
    case 0x00C9:
      return "T249";
    default:
      return "36v4";
  }
}

class Tic final : public LensMover {
 public:
  // From its first commands on the motor was told to stop, whatever of the rest fails.
  Tic(std::unique_ptr<UsbLink> link, const Settings& settings, Clock& clock)
      : link_(std::move(link)),
        settings_(settings),
        clock_(clock),
        ustep_(settings.step_length / settings.usteps_per_step) {
    check_identity();
    // First of all, for it may still be in the motion that a host which died has begun.
    command({Code::set_target_velocity, 0});
    command({Code::enter_safe_start});
    apply_settings();
    configure();
  }
  Tic(const Tic&) = delete;
  Tic& operator=(const Tic&) = delete;
  ~Tic() override {
    try {
      make_safe();
    } catch (...) {  // a destructor cannot report it; the motor's own command timeout remains
    }
  }

  std::string identity() const override;
  double position() const override { return meters(read_variables().current_position); }
  bool homed() const override { return !read_variables().position_uncertain; }
  double travel_min() const override { return settings_.travel_min; }
  double travel_max() const override { return settings_.travel_max; }
  void move_to(double position, Time timeout) override;
  void home(Time timeout) override;
  void make_safe() override;

 private:
  /// The controller counts from its home switch.
  /// m = home_position + usteps * ustep_, where ustep_ is negative for a lens that moves towards
  /// the eye when the motor goes forward.
  double meters(std::int32_t usteps) const { return settings_.home_position + usteps * ustep_; }
  std::int32_t usteps(double meters) const {
    return static_cast<std::int32_t>(std::lround((meters - settings_.home_position) / ustep_));
  }
  std::int32_t speed_units() const {
    return static_cast<std::int32_t>(std::lround(settings_.speed / std::abs(ustep_) * kPerSpeed));
  }
  // Units of the wire: usteps/s^2 times 100.
  std::int32_t acceleration_units() const {
    return static_cast<std::int32_t>(
        std::lround(settings_.acceleration / std::abs(ustep_) * kPerAcceleration));
  }
  /// The code of 2^code usteps a full step.
  std::uint8_t step_mode() const {
    return static_cast<std::uint8_t>(std::lround(std::log2(settings_.usteps_per_step)));
  }
  int timeout_ms() const { return static_cast<int>(std::lround(settings_.command_timeout * 1e3)); }

  void check_identity() const;
  void apply_settings();
  std::vector<std::pair<std::uint16_t, std::uint8_t>> wanted_settings() const;
  bool settings_are_as_wanted();
  void configure();
  void check_no_error(const Variables& now) const;
  void energize(Time deadline);
  void watch(Time deadline, const std::string& what,
             const std::function<bool(const Variables&)>& arrived);
  void drive(Time timeout, const std::string& what, const std::function<void()>& start,
             const std::function<bool(const Variables&)>& arrived);
  void stand_still();
  template <class Work>
  auto on_link(Work work) const;
  void command(const Command& what, Time timeout) const;
  void command(const Command& what) const {
    command(what, from_seconds(settings_.transfer_timeout));
  }
  std::vector<std::uint8_t> read(const Read& what) const;
  Variables read_variables() const;
  [[noreturn]] void fail(DeviceErrorKind kind, const std::string& what) const {
    throw DeviceError(kind, settings_.name, what);
  }

  const std::unique_ptr<UsbLink> link_;
  const Settings settings_;
  Clock& clock_;
  const double ustep_;  // m
};

/// Errors of the link, under the device's name in the rig.
/// The kind stays: a caller acts on that.
template <class Work>
auto Tic::on_link(Work work) const {
  try {
    return work();
  } catch (const DeviceError& error) {
    throw renamed(error, settings_.name);
  }
}

void Tic::command(const Command& what, Time timeout) const {
  on_link([&] { link_->write(encode(what), {}, timeout); });
}

std::vector<std::uint8_t> Tic::read(const Read& what) const {
  auto bytes = on_link([&] {
    return link_->read(encode(what), what.length, from_seconds(settings_.transfer_timeout));
  });
  if (bytes.size() != what.length)
    fail(DeviceErrorKind::protocol, "an answer of " + std::to_string(what.length) +
                                        " bytes is cut short: \"" + printable(bytes) + '"');
  return bytes;
}

// One transfer, so that position, velocity and state are of one moment.
Variables Tic::read_variables() const {
  const auto bytes = read({Code::get_variable, 0, kVariablesSize});
  const auto variables = decode_variables(bytes);
  if (!variables)
    fail(DeviceErrorKind::protocol,
         "its variables make no sense: \"" + printable(bytes, kVariablesSize) + '"');
  return *variables;
}

/// The firmware's version is bcdDevice: 0106 is 1.06.
std::string Tic::identity() const {
  const UsbIdentity& usb = link_->identity();
  char text[96];
  std::snprintf(text, sizeof text, "Pololu Tic %s, firmware %x.%02x, serial %s",
                model_of(usb.product), usb.release >> 8U, usb.release & 0xFFU, usb.serial.c_str());
  return text;
}

void Tic::check_identity() const {
  const UsbIdentity& usb = link_->identity();
  if (usb.vendor != kVendor ||
      std::find(kProducts.begin(), kProducts.end(), usb.product) == kProducts.end())
    fail(DeviceErrorKind::not_found,
         "this is no Tic: " + to_string("usb", {usb.vendor, usb.product, ""}));
}

/// Commands by USB; the safe start in force; the command timeout, little-endian; a soft error
/// decelerates and keeps the position.
std::vector<std::pair<std::uint16_t, std::uint8_t>> Tic::wanted_settings() const {
  return {{kControlMode, std::uint8_t{0}},
          {kDisableSafeStart, std::uint8_t{0}},
          {kCommandTimeoutSetting, static_cast<std::uint8_t>(timeout_ms() & 0xFF)},
          {static_cast<std::uint16_t>(kCommandTimeoutSetting + 1),
           static_cast<std::uint8_t>(timeout_ms() >> 8)},
          {kSoftErrorResponse, kDecelerateToHold}};
}

// The whole block is read, and only the bytes that matter here are compared.
bool Tic::settings_are_as_wanted() {
  const auto settings = read({Code::get_setting, 0, kSettingsSize});
  const auto wanted = wanted_settings();
  return std::all_of(wanted.begin(), wanted.end(),
                     [&](const auto& one) { return settings[one.first] == one.second; });
}

/// The settings live in a memory that wears out, so they are written only where they differ.
void Tic::apply_settings() {
  if (settings_are_as_wanted()) return;
  for (const auto& [offset, value] : wanted_settings())
    command({Code::set_setting, value, offset}, kSettingTimeout);
  command({Code::reinitialize}, kSettingTimeout);
  if (!settings_are_as_wanted()) fail(DeviceErrorKind::refused, "it does not keep its settings");
}

/// What is not kept in the settings' memory: step mode, current limit, speed, acceleration.
/// Read back as a whole at the end: a transfer that was acknowledged does not say that its value
/// was taken.
void Tic::configure() {
  const std::uint8_t current =
      code_from_current(link_->identity().product, settings_.current_limit);
  const bool counted_otherwise = read_variables().step_mode != step_mode();
  command({Code::set_step_mode, step_mode()});
  command({Code::set_current_limit, current});
  command({Code::set_max_speed, speed_units()});
  command({Code::set_max_acceleration, acceleration_units()});
  command({Code::set_max_deceleration, acceleration_units()});
  // Its counter is in steps of another size: a halt_and_hold marks the position as uncertain.
  if (counted_otherwise) command({Code::halt_and_hold});
  const Variables now = read_variables();
  const auto same = [](std::uint32_t is, std::int32_t wanted) {
    return is == static_cast<std::uint32_t>(wanted);
  };
  if (now.step_mode != step_mode() || now.current_limit != current ||
      !same(now.max_speed, speed_units()) || !same(now.max_acceleration, acceleration_units()) ||
      !same(now.max_deceleration, acceleration_units()))
    fail(DeviceErrorKind::refused,
         "it does not take its speed, acceleration, current limit or step mode");
}

/// In any state but the normal one the controller has stopped the motor, or is about to.
void Tic::check_no_error(const Variables& now) const {
  if (now.state != OperationState::normal)
    fail(DeviceErrorKind::refused,
         "the motor was stopped by its controller: " + names_of(now.error_status));
}

/// From whatever state to the normal one. Only a call that moves does this: leaving the normal
/// state sets the safe-start violation, which only an explicit command clears.
/// Repeated at each poll, for the 200 ms may pass before the coils have settled.
void Tic::energize(Time deadline) {
  const Time settled = std::min(deadline, clock_.now() + kEnergizing);
  for (;;) {
    command({Code::energize});
    command({Code::exit_safe_start});  // holds for 200 ms only, unless the state is normal by then
    const Variables now = read_variables();
    if (now.state == OperationState::normal) return;
    if (const auto lasting = static_cast<std::uint16_t>(now.error_status & ~kEndsByItself);
        lasting != 0)
      fail(DeviceErrorKind::refused, "the motor cannot move: " + names_of(lasting));
    if (clock_.now() >= settled)
      fail(DeviceErrorKind::timeout, "the motor does not get ready: " + names_of(now.error_status));
    clock_.sleep_for(kPoll);
  }
}

/// Polls until `arrived`, and feeds the command timeout at least four times within its period:
/// should this task hang, the motor stops by itself.
void Tic::watch(Time deadline, const std::string& what,
                const std::function<bool(const Variables&)>& arrived) {
  const Time pause = std::min(kPoll, from_seconds(settings_.command_timeout / 4));
  for (;;) {
    const Variables now = read_variables();
    check_no_error(now);
    if (arrived(now)) return;
    if (clock_.now() >= deadline) fail(DeviceErrorKind::timeout, what + " in time");
    clock_.sleep_until(std::min(deadline, clock_.now() + pause));
    command({Code::reset_command_timeout});  // reads do not feed it
  }
}

/// One motion from energizing to arrival. However it fails, the motor is stopped before the error
/// is thrown.
void Tic::drive(Time timeout, const std::string& what, const std::function<void()>& start,
                const std::function<bool(const Variables&)>& arrived) {
  const Time deadline = later(clock_.now(), timeout);
  try {
    energize(deadline);
    start();
    watch(deadline, what, arrived);
  } catch (...) {
    try {
      make_safe();
    } catch (const DeviceError&) {
      // The first error says more; the motor's command timeout remains.
    }
    throw;
  }
}

// The travel is checked first, then the reference: no command has gone to the motor by then.
void Tic::move_to(double position, Time timeout) {
  if (!(position >= settings_.travel_min && position <= settings_.travel_max))
    fail(DeviceErrorKind::out_of_range, in_millimeters(position) + " is outside the travel from " +
                                            in_millimeters(settings_.travel_min) + " to " +
                                            in_millimeters(settings_.travel_max));
  // Open loop: an uncertain position would end the lens somewhere else.
  if (!homed()) fail(DeviceErrorKind::refused, "it does not know its position; home it first");
  const std::int32_t target = usteps(position);
  drive(
      timeout, "not at " + in_millimeters(position),
      [&] {
        command({Code::set_target_position, target});
      },
      // Both position and velocity: on its way past a target the counter shows it for a moment.
      [&](const Variables& now) {
        if (now.position_uncertain)
          fail(DeviceErrorKind::refused, "it lost its position on the way; home it again");
        return now.current_position == target && now.current_velocity == 0;
      });
}

/// Without a switch: the present position becomes home_position. With one: the controller's own
/// homing, to the switch and back until it is just released.
void Tic::home(Time timeout) {
  if (settings_.home == Home::none) {
    command({Code::halt_and_set_position, 0});
    if (!homed()) fail(DeviceErrorKind::refused, "it does not take its position");
    return;
  }
  const bool forward = settings_.home == Home::forward;
  // It would look for a switch that is not there for ever (guide, 5.6), and drive the lens into its
  // end stop, which in one direction is the eye.
  if (read({Code::get_setting, forward ? kLimitSwitchForwardMap : kLimitSwitchReverseMap, 1})[0] ==
      0)
    fail(DeviceErrorKind::refused,
         std::string("none of its pins is configured as the limit switch ") +
             (forward ? "forward" : "reverse") +
             "; configure one (Tic Control Center), or take home = \"none\"");
  drive(
      timeout, "the home switch was not found",
      [&] {
        command({Code::go_home, forward});
      },
      [](const Variables& now) { return !now.homing && !now.position_uncertain; });
}

/// Decelerates, then forbids motion until the next call that moves. Deceleration takes v / a; where
/// it is not over after twice that, the halt is abrupt, which makes the position uncertain.
/// Not broken off by a stop of the task: half a deceleration is no safe state.
void Tic::make_safe() {
  const StopShield shield(clock_);
  command({Code::set_target_velocity, 0});
  const Time deadline =
      clock_.now() + from_seconds(2 * settings_.speed / settings_.acceleration) + 100ms;
  while (read_variables().current_velocity != 0) {
    if (clock_.now() >= deadline) {
      command({Code::halt_and_hold});
      break;
    }
    clock_.sleep_for(kPoll);
  }
  command({Code::enter_safe_start});
}

}  // namespace

void Settings::check() const {
  const auto positive = [](double value, double most, const char* setting) {
    if (!(std::isfinite(value) && value > 0 && value <= most))
      throw std::invalid_argument(std::string(setting) + ": must be in (0, " +
                                  std::to_string(most) + "]");
  };
  if (name.empty()) throw std::invalid_argument("name: must not be empty");
  positive(std::abs(step_length), 0.01, "step_length");
  // A power of two: n & (n - 1) clears the lowest set bit.
  if (usteps_per_step < 1 || usteps_per_step > 32 || (usteps_per_step & (usteps_per_step - 1)) != 0)
    throw std::invalid_argument("usteps_per_step: must be 1, 2, 4, 8, 16 or 32");
  const double ustep = std::abs(step_length) / usteps_per_step;
  // 5e8 is the largest number that the controller takes for a speed.
  positive(speed, 5e8 / kPerSpeed * ustep, "speed");
  positive(acceleration, 0x7FFFFFFF / kPerAcceleration * ustep, "acceleration");
  if (acceleration < ustep)
    throw std::invalid_argument("acceleration: is too little for the controller");
  if (!(std::isfinite(travel_min) && std::isfinite(travel_max) && travel_min < travel_max))
    throw std::invalid_argument("travel_min: must be less than travel_max");
  // The position counter has 32 bits.
  const double reach =
      std::max(std::abs(travel_min - home_position), std::abs(travel_max - home_position));
  if (!(reach < std::numeric_limits<std::int32_t>::max() * ustep))
    throw std::invalid_argument("home_position: the travel is too far from it to be counted");
  positive(current_limit, 10, "current_limit");
  if (!(command_timeout >= 0.1 && command_timeout <= 60))
    throw std::invalid_argument("command_timeout: must be in [0.1, 60] s");
  positive(transfer_timeout, command_timeout, "transfer_timeout");
}

std::unique_ptr<LensMover> open(std::unique_ptr<UsbLink> link, const Settings& settings,
                                Clock& clock) {
  if (!link) throw std::invalid_argument("link: must not be null");
  settings.check();
  return std::make_unique<Tic>(std::move(link), settings, clock);
}

}  // namespace vitreo::pololu_tic
