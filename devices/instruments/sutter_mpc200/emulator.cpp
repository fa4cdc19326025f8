// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/sutter_mpc200/emulator.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <utility>

namespace vitreo::sutter_mpc200 {
namespace {

/// m/s, of 'N'; the true speed is not known.
constexpr double kCalibration = 2e-3;

/// One motion at a time, of the active drive, at constant speed from its position to to_. An answer
/// comes only at its end, and none to a motion that is too short to be made.
class EmulatedMpc200 final : public Emulator {
 public:
  explicit EmulatedMpc200(const EmulatorSettings& settings)
      : connected_(settings.connected),
        version_(settings.version),
        straight_pause_(settings.straight_pause) {
    positions_.fill(settings.start);
  }

  void receive(std::span<const std::uint8_t> bytes, Time now) override {
    for (const std::uint8_t byte : bytes) hear(byte, now);
  }
  std::vector<TimedBytes> say(Time now) override {
    if (under_way_ && now >= arrival_) end_motion();
    return std::exchange(said_, {});
  }
  Time next() const override {
    if (!said_.empty()) return said_.front().at;
    return under_way_ ? arrival_ : kForever;
  }

  /// On a straight line at constant speed; only the active drive can be under way.
  Usteps position(int drive, Time now) const override {
    const Usteps& from = positions_[static_cast<std::size_t>(drive - 1)];
    if (!under_way_ || drive != active_ || now <= begun_) return from;
    if (now >= arrival_) return to_;
    const double gone = to_seconds(now - begun_) / to_seconds(arrival_ - begun_);
    Usteps at{};
    for (std::size_t i = 0; i < 3; ++i)
      at[i] = from[i] + static_cast<std::int32_t>(
                            std::lround(gone * (static_cast<double>(to_[i]) - from[i])));
    return at;
  }
  bool moving(Time now) const override { return under_way_ && now < arrival_; }
  bool crashed() const override { return crashed_; }
  void fall_silent() override { silent_ = true; }
  void stop_short(double part) override { part_ = part; }
  void power_cycle(Time now) override {
    active_position() = position(active_, now);
    under_way_ = silent_ = crashed_ = interrupted_ = false;
    active_ = 1;
    heard_.clear();
    said_.clear();
  }

 private:
  Usteps& active_position() { return positions_[static_cast<std::size_t>(active_ - 1)]; }

  /// Byte by byte: commands have no end mark, so each is complete when it has its length.
  /// The second byte of a straight motion that comes too early crashes it, as it does the real one
  /// (acq4): from then on it hears nothing.
  void hear(std::uint8_t byte, Time now) {
    if (crashed_) return;
    if (under_way_ && now >= arrival_) end_motion();
    if (under_way_) {
      if (byte == kInterrupt) interrupt(now);
      return;
    }
    if (heard_.size() == 1 && heard_.front() == 'S' && now - begun_hearing_ < straight_pause_) {
      crashed_ = true;
      return;
    }
    if (heard_.empty()) begun_hearing_ = now;
    heard_.push_back(byte);
    const std::size_t size = size_of(heard_.front());
    if (heard_.size() < size) return;
    if (const auto command = decode_command(std::exchange(heard_, {})))
      std::visit([&](const auto& what) { obey(what, now); }, *command);
  }

  /// The CR comes at once, and 'I' stands before the next reply.
  void interrupt(Time now) {
    active_position() = position(active_, now);
    under_way_ = false;
    speak({kEnd}, now);
    interrupted_ = true;
  }
  void end_motion() {
    under_way_ = false;
    active_position() = to_;
    speak({kEnd}, arrival_);
  }
  // `part` below 1 ends the motion short of its target, for tests of what a driver makes of that.
  void set_off(const Usteps& target, double speed, double part, Time now) {
    double way = 0;
    for (std::size_t i = 0; i < 3; ++i) {
      const double full =
          static_cast<double>(std::clamp(target[i], 0, kTravel_usteps)) - active_position()[i];
      to_[i] = active_position()[i] + static_cast<std::int32_t>(std::lround(part * full));
      way = std::max(way, std::abs(full));
    }
    begun_ = now;
    arrival_ = later(now, from_seconds(part * way * kUstep / speed));
    under_way_ = true;
  }
  /// Shorter than 16 usteps on every axis: neither made nor answered.
  void move(const Usteps& target, double speed, Time now) {
    bool any = false;
    for (std::size_t i = 0; i < 3; ++i)
      any = any || std::abs(static_cast<std::int64_t>(target[i]) - active_position()[i]) >=
                       kLeastMotion_usteps;
    if (any) set_off(target, speed, part_, now);
  }

  void obey(const GetDrive&, Time now) { speak(encode_drive({active_, version_}), now); }
  void obey(const GetDrives&, Time now) { speak(encode_drives(connected_), now); }
  void obey(const SelectDrive& command, Time now) {
    const bool is_there = command.drive >= 1 && command.drive <= kDrives &&
                          connected_[static_cast<std::size_t>(command.drive - 1)];
    if (is_there) active_ = command.drive;
    speak({is_there ? static_cast<std::uint8_t>(command.drive) : kNoSuchDrive, kEnd}, now);
  }
  void obey(const GetPosition&, Time now) {
    speak(encode_position({active_, active_position()}), now);
  }
  void obey(const FastMove& command, Time now) { move(command.target, kFastMotion, now); }
  void obey(const StraightMove& command, Time now) {
    move(command.target, speed_of(command.speed), now);
  }
  void obey(const Calibrate&, Time now) { set_off({0, 0, 0}, kCalibration, 1, now); }
  void obey(const Interrupt&, Time now) { speak({kEnd}, now); }

  /// The mark of an interrupted motion stands before the next reply, once.
  void speak(ByteString bytes, Time now) {
    if (silent_) return;
    if (std::exchange(interrupted_, false)) bytes.insert(bytes.begin(), kInterrupted);
    said_.push_back({now, std::move(bytes)});
  }

  const Connected connected_;
  const int version_;
  const Time straight_pause_;
  std::array<Usteps, kDrives> positions_{};
  int active_ = 1;
  Usteps to_{};
  Time begun_{};
  Time arrival_{};
  Time begun_hearing_{};  // of the command that is not complete
  bool under_way_ = false;
  bool silent_ = false;
  bool crashed_ = false;
  bool interrupted_ = false;
  double part_ = 1;
  ByteString heard_;
  std::vector<TimedBytes> said_;
};

}  // namespace

std::unique_ptr<Emulator> make_emulator(const EmulatorSettings& settings) {
  return std::make_unique<EmulatedMpc200>(settings);
}

}  // namespace vitreo::sutter_mpc200
