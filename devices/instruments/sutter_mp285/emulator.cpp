// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/sutter_mp285/emulator.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace vitreo::sutter_mp285 {
namespace {

/// One motion at a time: from from_ to to_, begun at begun_, at constant speed, without
/// acceleration. While it is under way every byte interrupts it; its answer comes at its end.
class EmulatedMp285 final : public Emulator {
 public:
  explicit EmulatedMp285(const EmulatorSettings& settings)
      : version_(settings.version), from_(settings.start), to_(settings.start) {}

  void receive(std::span<const std::uint8_t> bytes, Time now) override {
    for (const std::uint8_t byte : bytes) hear(byte, now);
  }
  std::vector<TimedBytes> say(Time now) override {
    if (under_way_ && now >= arrival()) end_motion();
    return std::exchange(said_, {});
  }
  // The end of a motion is something that it says by itself.
  Time next() const override {
    if (!said_.empty()) return said_.front().at;
    return under_way_ ? arrival() : kForever;
  }

  // On a straight line; part 1 where there is no way at all.
  Usteps position(Time now) const override {
    const double gone =
        way() > 0 ? std::clamp(to_seconds(now - begun_) * speed() / way(), 0., 1.) : 1;
    Usteps at{};
    for (std::size_t i = 0; i < 3; ++i)
      at[i] = from_[i] + static_cast<std::int32_t>(std::lround(gone * (to_[i] - from_[i])));
    return at;
  }
  bool moving(Time now) const override { return under_way_ && now < arrival(); }
  void fall_silent() override { silent_ = true; }
  void stop_short(double part) override { part_ = part; }
  void power_cycle(Time now) override {
    from_ = to_ = position(now);
    under_way_ = awake_ = silent_ = false;
    heard_.clear();
    said_.clear();
  }

 private:
  /// usteps, of the axis with the longest way.
  double way() const {
    double longest = 0;
    for (std::size_t i = 0; i < 3; ++i)
      longest = std::max(longest, std::abs(static_cast<double>(to_[i]) - from_[i]));
    return longest;
  }
  /// usteps/s: 25 a um.
  double speed() const { return velocity_.speed * 25.; }
  Time arrival() const { return later(begun_, from_seconds(way() / std::max(1., speed()))); }

  /// A command is complete when it has the length of its letter; an unknown letter is answered by
  /// "bad command".
  void hear(std::uint8_t byte, Time now) {
    if (under_way_ && now >= arrival()) end_motion();
    if (under_way_) return interrupt(byte, now);
    heard_.push_back(byte);
    const std::size_t size = size_of(heard_.front());
    if (heard_.size() < size) return;
    const auto command = decode_command(std::exchange(heard_, {}));
    // Before the first V nothing works.
    awake_ = awake_ || (command && std::holds_alternative<SetVelocity>(*command));
    if (!awake_) return;
    if (!command) return speak(encode_fault({.bad_command = true}), now);
    std::visit([&](const auto& what) { obey(what, now); }, *command);
  }

  /// Stands where it was. An interrupt is answered by '=' and CR, any other byte by the error "bad
  /// command, interrupted".
  void interrupt(std::uint8_t byte, Time now) {
    from_ = to_ = position(now);
    under_way_ = false;
    if (byte == kInterrupt) return speak({kInterrupted, kEnd}, now);
    speak(encode_fault({.bad_command = true, .interrupted = true}), now);
  }

  void end_motion() {
    under_way_ = false;
    from_ = to_;
    speak({kEnd}, arrived_);
  }

  void obey(const GetPosition&, Time now) { speak(encode_position(from_), now); }
  // Without an answer now: that comes in end_motion().
  void obey(const Move& command, Time now) {
    begun_ = now;
    for (std::size_t i = 0; i < 3; ++i) {
      const double wanted =
          absolute_ ? command.target[i] : static_cast<double>(from_[i]) + command.target[i];
      to_[i] = from_[i] + static_cast<std::int32_t>(std::lround(part_ * (wanted - from_[i])));
    }
    under_way_ = true;
    arrived_ = arrival();
  }
  void obey(const SetVelocity& command, Time now) { done(velocity_ = command, now); }
  void obey(const SetOrigin&, Time now) { done(from_ = to_ = Usteps{}, now); }
  void obey(const Absolute&, Time now) { done(absolute_ = true, now); }
  void obey(const Relative&, Time now) { done(absolute_ = false, now); }
  void obey(const Refresh&, Time now) { done(0, now); }
  void obey(const GetStatus&, Time now) {
    speak(encode_status({absolute_, velocity_, 25, version_}), now);
  }
  void obey(const Interrupt&, Time now) { done(0, now); }

  template <class Nothing>
  void done(const Nothing&, Time now) {
    speak({kEnd}, now);
  }
  void speak(const ByteString& bytes, Time now) {
    if (!silent_) said_.push_back({now, bytes});
  }

  const int version_;
  Usteps from_;
  Usteps to_;
  Time begun_{};
  Time arrived_{};
  bool under_way_ = false;
  bool awake_ = false;  // it has had its first V
  bool absolute_ = true;
  bool silent_ = false;
  double part_ = 1;  // of each way, after which its motions end
  SetVelocity velocity_{1000, true};
  ByteString heard_;
  std::vector<TimedBytes> said_;
};

}  // namespace

std::unique_ptr<Emulator> make_emulator(const EmulatorSettings& settings) {
  return std::make_unique<EmulatedMp285>(settings);
}

}  // namespace vitreo::sutter_mp285
