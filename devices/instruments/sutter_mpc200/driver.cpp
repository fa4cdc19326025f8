// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/sutter_mpc200/driver.h"

#include "devices/instruments/stage_driver.h"
#include "devices/instruments/sutter_mpc200/wire.h"
#include "devices/time/error.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <stdexcept>
#include <utility>

namespace vitreo::sutter_mpc200 {
namespace {

using namespace std::chrono_literals;

/// The least rest between two commands, by the manual.
constexpr Time kBetween = 2ms;
/// After which nothing more comes: 14 bytes take 1.1 ms at 128000 baud.
constexpr Time kSilence = 20ms;
/// A motion may take this much longer than distance over speed: the speeds were measured on one
/// stage, and differ from stage to stage.
constexpr double kMotionFactor = 1.5;
constexpr Time kMotionMargin = 1s;
/// 25 mm at its slowest take 74 s; and a quarter.
constexpr Time kLongestHoming = 100s;
/// In place of a straight motion's speed: all axes at full speed, on a bent path.
constexpr int kFast = -1;

/// The fastest that is not faster than `speed`; nothing when it cannot go so slowly.
/// Rounding down keeps the speed at or below what was asked for.
std::optional<int> code_for(double speed) {
  const double most = speed * (1 + 1e-3);  // so that a rounded table value means itself
  if (most >= kFastMotion) return kFast;
  for (int code = kFastest; code >= kSlowest; --code)
    if (speed_of(code) <= most) return code;
  return std::nullopt;
}

class Mpc200 final : public SilentStageProtocol {
 public:
  Mpc200(std::unique_ptr<ByteLink> link, const Settings& settings, Clock& clock)
      : SilentStageProtocol(std::move(link), settings.name, clock,
                            {.ustep = kUstep,
                             .usteps_per_um = kUsteps_per_um,
                             .tolerance = kLeastMotion_usteps - 1,
                             .silence = kSilence,
                             .reply_timeout = settings.reply_timeout,
                             .end = kEnd,
                             .interrupt = kInterrupt}),
        settings_(settings) {}
  StageInfo configure() override;
  void set_off(std::span<const double> target, double speed) override;
  void set_off_home() override;

 private:
  Usteps where() override;
  void resynchronize() override;
  [[noreturn]] void fail_for(std::uint8_t answer) const override;
  void send(const Command& command);
  ByteString ask(const Command& question, std::size_t size);
  void take_drive();

  const Settings settings_;
};

void Mpc200::fail_for(std::uint8_t answer) const {
  if (answer == kInterrupted) fail(DeviceErrorKind::refused, "its motion was interrupted");
  fail(DeviceErrorKind::protocol, "an answer that is none: " + printable(std::span(&answer, 1)));
}

/// Not during a motion. A straight motion in one write would crash the controller (acq4), so its
/// first byte goes alone.
void Mpc200::send(const Command& command) {
  if (unsure_) resynchronize();
  clock().sleep_for(kBetween);
  dialogue.discard();
  unsure_ = true;
  const ByteString bytes = encode(command);
  if (!std::holds_alternative<StraightMove>(command)) return dialogue.send(bytes, name_of(command));
  dialogue.send(std::span(bytes).first(1), name_of(command));
  clock().sleep_for(std::chrono::milliseconds(kStraightPause_ms + 5));
  dialogue.send(std::span(bytes).subspan(1), name_of(command));
}

/// `size` bytes and a CR; the mark 'I' of an interrupted motion may stand before them. No reply
/// begins with 'I': the first byte is a drive, 1 to 4, a count of drives or 'E'.
ByteString Mpc200::ask(const Command& question, std::size_t size) {
  send(question);
  const Time deadline = reply_deadline();
  ByteString reply = dialogue.take(1, deadline);
  if (reply.front() == kInterrupted) reply = dialogue.take(1, deadline);
  const ByteString rest = dialogue.take(size + 1 - reply.size(), deadline);
  reply.insert(reply.end(), rest.begin(), rest.end());
  if (reply.back() != kEnd)
    fail(DeviceErrorKind::protocol, "an answer without its end: " + printable(reply));
  unsure_ = false;
  return reply;
}

// 'I' and the number of the drive; answered by that number, or by 'E' where none is connected.
void Mpc200::take_drive() {
  const ByteString reply = ask(SelectDrive{settings_.drive}, 1);
  if (reply.front() == kNoSuchDrive)
    fail(DeviceErrorKind::not_found,
         "drive " + std::to_string(settings_.drive) + " is not connected");
  if (reply.front() != settings_.drive)
    fail(DeviceErrorKind::protocol, "it took another drive than it was told: " + printable(reply));
}

/// The answer names the active drive: at the panel another one may have been selected meanwhile,
/// and its position must not be taken for this one's.
Usteps Mpc200::where() {
  for (int attempt = 0; attempt < 2; ++attempt) {
    const ByteString reply = ask(GetPosition{}, kPositionSize);
    const auto is = decode_position(reply);
    if (!is) fail(DeviceErrorKind::protocol, "an answer that is no position: " + printable(reply));
    if (is->drive == settings_.drive) return is->position;
    take_drive();
  }
  fail(DeviceErrorKind::refused,
       "it does not keep drive " + std::to_string(settings_.drive) + " active");
}

/// The interrupt ends whatever it does.
/// The answer, and what may still come of an older one, is discarded together.
void Mpc200::resynchronize() {
  unsure_ = false;
  moving_ = false;
  dialogue.send(encode(Interrupt{}), name_of(Interrupt{}));
  dialogue.settle(kSilence);
}

/// The firmware's version, two BCD bytes, and the list of drives identify the controller.
StageInfo Mpc200::configure() {
  resynchronize();
  std::optional<Drive> is;
  try {
    is = decode_drive(ask(GetDrive{}, kDriveSize));
  } catch (const DeviceError& error) {
    if (error.kind != DeviceErrorKind::protocol) throw;
    fail(DeviceErrorKind::not_found, "this is no MPC-200: " + error.text);
  }
  if (!is)
    fail(DeviceErrorKind::not_found, "this is no MPC-200: it names no drive and no firmware");
  dialogue.identified();
  const auto connected = decode_drives(ask(GetDrives{}, kDrivesSize));
  if (!connected || !(*connected)[static_cast<std::size_t>(settings_.drive - 1)])
    fail(DeviceErrorKind::not_found,
         "drive " + std::to_string(settings_.drive) + " is not connected");
  take_drive();
  where();
  std::array<char, 16> version{};
  std::snprintf(version.data(), version.size(), "%d.%02d", is->version / 100, is->version % 100);
  StageInfo info{{"Sutter MPC-200", "", version.data()}, {}};
  for (std::size_t i = 0; i < 3; ++i)
    info.axes.push_back({std::string(1, "xyz"[i]), settings_.travel_min[i], settings_.travel_max[i],
                         settings_.max_speed, settings_.speed, kLeastMotion_usteps * kUstep});
  return info;
}

/// There is no command for the speed: it is a part of the straight motion, or full speed.
void Mpc200::set_off(std::span<const double> target, double speed) {
  const auto code = code_for(speed);
  if (!code) fail(DeviceErrorKind::refused, "its slowest motion is 0.338 mm/s");
  from_ = where();
  const std::int32_t longest = aim(target);
  // The stage stands within that of its target already, and check_arrival() allows so much.
  if (longest < kLeastMotion_usteps) return;  // it would not move, and not answer either
  speed_ = *code == kFast ? kFastMotion : speed_of(*code);
  if (*code == kFast)
    send(FastMove{target_});
  else
    send(StraightMove{*code, target_});
  begin(later(from_seconds(kMotionFactor * longest * kUstep / speed_), kMotionMargin));
}

/// 'N' calibrates: all axes go to the beginning of their travel, which becomes 0.
void Mpc200::set_off_home() {
  from_ = where();
  target_ = {0, 0, 0};
  speed_ = speed_of(kFastest);  // of the estimate only: its own is not known
  send(Calibrate{});
  begin(kLongestHoming);
}

}  // namespace

void Settings::check() const {
  if (name.empty()) throw std::invalid_argument("name: must not be empty");
  if (drive < 1 || drive > kDrives) throw std::invalid_argument("drive: must be 1 to 4");
  for (std::size_t i = 0; i < 3; ++i) {
    if (!(travel_min[i] < travel_max[i]))
      throw std::invalid_argument("travel_min: must be below travel_max");
    if (!(travel_min[i] >= 0 && std::lround(travel_max[i] / kUstep) <= kTravel_usteps))
      throw std::invalid_argument("travel_min, travel_max: must lie within 0 to 25 mm");
  }
  if (!(max_speed >= speed_of(kSlowest) && max_speed <= 5e-3))
    throw std::invalid_argument("max_speed: must be 0.338 to 5 mm/s");
  if (!(speed >= speed_of(kSlowest)) || speed > max_speed)
    throw std::invalid_argument("speed: must be 0.338 mm/s at least and max_speed at most");
  if (!(std::isfinite(reply_timeout) && reply_timeout > 0))
    throw std::invalid_argument("reply_timeout: must be positive");
}

std::unique_ptr<Stage> open(std::unique_ptr<ByteLink> link, const Settings& settings,
                            Clock& clock) {
  settings.check();
  return make_stage(std::make_unique<Mpc200>(std::move(link), settings, clock));
}

}  // namespace vitreo::sutter_mpc200
