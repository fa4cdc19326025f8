// SPDX-License-Identifier: Apache-2.0
#include "devices/roles/reopening.h"

#include "devices/time/error.h"

#include <optional>
#include <stdexcept>
#include <utility>
#include <vector>

namespace vitreo {
namespace {

/// As the instrument reports it; compared when it comes back.
template <class Role>
std::string identity_of(const Role& device) {
  return device.identity();
}
template <>
std::string identity_of(const Camera& device) {
  return device.info().identity;
}

/// What a call does for an instrument that is gone: opens it again, or fails as lost.
enum class Gone { comes_back, stays };

/// What all roles have in common: the instrument, or that it is gone. Called with the clock's baton
/// only.
template <class Role>
class Held {
 public:
  using Open = std::function<std::unique_ptr<Role>()>;
  Held(Open open, ReopeningSettings settings, const Clock& clock)
      : open_(std::move(open)), settings_(std::move(settings)), clock_(clock) {
    if (!open_) throw std::invalid_argument("open: must not be empty");
    if (settings_.name.empty()) throw std::invalid_argument("name: must not be empty");
    if (settings_.retry < Time::zero()) throw std::invalid_argument("retry: must not be negative");
    device_ = open_();
    identity_ = identity_of(*device_);
  }

  const std::string& identity() const { return identity_; }
  /// The instrument, for what needs no link; null when it is gone.
  const Role* now() const { return gone_ ? nullptr : device_.get(); }
  int times_opened() const { return times_opened_; }

  /// Calls `call(device)`, and notes when the instrument is lost during that.
  /// The device is held by a copy of the pointer, so that a task inside of it is not left with a
  /// dangling one when another task opens it anew.
  template <class Call>
  auto use(Gone gone, const Call& call) {
    if (gone_ && gone == Gone::stays) fail("it was lost; make it safe first: that opens it again");
    if (gone_) come_back();
    const std::shared_ptr<Role> device = device_;
    try {
      return call(*device);
    } catch (const DeviceError& error) {
      // Not when another task has opened it again during this call: then the new one is there.
      gone_ = gone_ || (error.kind == DeviceErrorKind::lost && device == device_);
      throw;
    }
  }

 private:
  /// Under the name of the rig, not of the link.
  [[noreturn]] void fail(const std::string& what,
                         DeviceErrorKind kind = DeviceErrorKind::lost) const {
    throw DeviceError(kind, settings_.name, what);
  }

  /// Opens it again, at most once within `retry`; opening waits, so a second task may get here
  /// meanwhile.
  void come_back() {
    if (opening_ || (tried_ && clock_.now() - *tried_ < settings_.retry))
      fail("it was lost, and is not back yet");
    opening_ = true;
    // Its port must be free. Only here, for a camera that is gone takes seconds to close.
    device_.reset();
    try {
      std::unique_ptr<Role> back = open_();
      if (identity_of(*back) != identity_)
        fail("another instrument came back: " + identity_of(*back) + " instead of " + identity_,
             DeviceErrorKind::refused);
      device_ = std::move(back);
    } catch (const DeviceError& error) {
      tried_ = clock_.now();
      opening_ = false;
      // Another instrument came back: that error of ours is passed on as it is.
      if (error.kind == DeviceErrorKind::refused && error.device == settings_.name) throw;
      fail("it was lost, and cannot be opened again: " + renamed(error, settings_.name).text);
    } catch (...) {
      opening_ = false;
      throw;
    }
    opening_ = gone_ = false;
    tried_.reset();
    ++times_opened_;
  }

  const Open open_;
  const ReopeningSettings settings_;
  const Clock& clock_;
  std::string identity_;
  // Shared with the calls under way: of two tasks inside the same instrument one may find it lost,
  // and open it again.
  std::shared_ptr<Role> device_;
  bool gone_ = false;
  bool opening_ = false;
  std::optional<Time> tried_;  // the last attempt that failed
  int times_opened_ = 1;
};

/// The line of a device that may be gone. A beat opens nothing: only make_safe() does.
template <class Role>
class ReopeningLine final : public EnableLine {
 public:
  explicit ReopeningLine(Held<Role>& held) : held_(held) {
    held_.use(Gone::stays, [this](Role& device) {
      there_ = device.enable_line() != nullptr;
      if (there_) identity_ = device.enable_line()->identity();
    });
  }
  bool there() const { return there_; }
  std::string identity() const override { return identity_; }
  void set(bool high) override {
    held_.use(Gone::stays, [high](Role& device) { device.enable_line()->set(high); });
    high_ = high;
  }
  bool high() const override { return high_; }
  void make_safe() override {
    held_.use(Gone::comes_back, [](Role& device) { device.enable_line()->make_safe(); });
    high_ = false;
  }

 private:
  Held<Role>& held_;
  bool there_ = false;
  std::string identity_;
  bool high_ = false;
};

/// A set-point never opens it: only make_safe() does, at zero.
class ReopeningAmplifier final : public CoilAmplifier {
 public:
  explicit ReopeningAmplifier(Held<CoilAmplifier> held)
      : held_(std::move(held)),
        line_(held_),
        channels_(held_.now()->channels()),
        limit_(held_.now()->current_limit()),
        last_(static_cast<std::size_t>(channels_), 0.0) {}
  std::string identity() const override { return held_.identity(); }
  int channels() const override { return channels_; }
  double current_limit() const override { return limit_; }
  std::vector<double> currents() const override {
    return held_.now() != nullptr ? held_.now()->currents() : last_;
  }
  // Refused while it is gone: a current must not begin to flow because a cable was put back.
  void set_currents(std::span<const double> currents) override {
    held_.use(Gone::stays, [&](CoilAmplifier& device) { device.set_currents(currents); });
    last_.assign(currents.begin(), currents.end());
  }
  std::optional<std::vector<double>> measured_currents() override {
    std::optional<std::vector<double>> measured;
    held_.use(Gone::stays, [&](CoilAmplifier& device) { measured = device.measured_currents(); });
    return measured;
  }
  LinkState link_state() const override {
    return held_.now() != nullptr ? held_.now()->link_state()
                                  : LinkState{.hung_up = held_.identity()};
  }
  void make_safe() override {
    held_.use(Gone::comes_back, [](CoilAmplifier& device) { device.make_safe(); });
    last_.assign(last_.size(), 0.0);
  }
  EnableLine* enable_line() override { return line_.there() ? &line_ : nullptr; }

 private:
  Held<CoilAmplifier> held_;
  ReopeningLine<CoilAmplifier> line_;
  const int channels_;
  const double limit_;
  std::vector<double> last_;  // A, as last set: what a lost one may still hold
};

/// As the amplifier: only make_safe(), or level 0, opens it.
class ReopeningLamp final : public Lamp {
 public:
  explicit ReopeningLamp(Held<Lamp> held) : held_(std::move(held)), line_(held_) {}
  std::string identity() const override { return held_.identity(); }
  void set_level(double level) override {
    if (level == 0) return make_safe();
    held_.use(Gone::stays, [&](Lamp& device) { device.set_level(level); });
    last_ = level;
  }
  double level() const override { return held_.now() != nullptr ? held_.now()->level() : last_; }
  void ask() override {
    held_.use(Gone::stays, [](Lamp& device) { device.ask(); });
  }
  LinkState link_state() const override {
    return held_.now() != nullptr ? held_.now()->link_state()
                                  : LinkState{.hung_up = held_.identity()};
  }
  void make_safe() override {
    held_.use(Gone::comes_back, [](Lamp& device) { device.make_safe(); });
    last_ = 0;
  }
  EnableLine* enable_line() override { return line_.there() ? &line_ : nullptr; }

 private:
  Held<Lamp> held_;
  ReopeningLine<Lamp> line_;
  double last_ = 0;
};

/// Its travel is kept from the first opening, so that asking for it opens nothing.
class ReopeningLensMover final : public LensMover {
 public:
  explicit ReopeningLensMover(Held<LensMover> held)
      : held_(std::move(held)),
        travel_min_(held_.now()->travel_min()),
        travel_max_(held_.now()->travel_max()) {}
  std::string identity() const override { return held_.identity(); }
  double travel_min() const override { return travel_min_; }
  double travel_max() const override { return travel_max_; }
  // A driver that came back may have lost its reference: its own homed() says so.
  double position() const override {
    return held_.use(Gone::comes_back, [](LensMover& device) { return device.position(); });
  }
  bool homed() const override {
    return held_.use(Gone::comes_back, [](LensMover& device) { return device.homed(); });
  }
  void move_to(double position, Time timeout) override {
    held_.use(Gone::comes_back, [&](LensMover& device) { device.move_to(position, timeout); });
  }
  void home(Time timeout) override {
    held_.use(Gone::comes_back, [&](LensMover& device) { device.home(timeout); });
  }
  void make_safe() override {
    held_.use(Gone::comes_back, [](LensMover& device) { device.make_safe(); });
  }

 private:
  mutable Held<LensMover> held_;  // asking for its position may open it
  const double travel_min_;
  const double travel_max_;
};

/// Frames are numbered through all openings: a camera's own numbers begin anew with each.
class ReopeningCamera final : public Camera {
 public:
  explicit ReopeningCamera(Held<Camera> held)
      : held_(std::move(held)), info_(held_.now()->info()) {}
  const CameraInfo& info() const override { return info_; }
  // A new opening is noticed within the call, before its first frame is numbered.
  Frame grab(Time timeout) override {
    Frame frame = held_.use(Gone::comes_back, [&](Camera& device) {
      if (times_opened_ != held_.times_opened()) begin_again(device);
      Frame newest = device.grab(timeout);
      counted_ = device.statistics();
      return newest;
    });
    frame.number += numbers_before_;
    last_number_ = frame.number;
    return frame;
  }
  // Between a new opening and its first grab the counts of the former one still stand.
  CameraStatistics statistics() const override {
    const CameraStatistics now = held_.now() != nullptr && times_opened_ == held_.times_opened()
                                     ? held_.now()->statistics()
                                     : counted_;
    return {before_.delivered + now.delivered, before_.lost + now.lost, before_.torn + now.torn};
  }
  std::string feature(const std::string& name) override {
    return held_.use(Gone::comes_back, [&](Camera& device) { return device.feature(name); });
  }
  // What a script has set is gone with the camera: a new opening has what the rig file says.
  std::string set_feature(const std::string& name, const std::string& value) override {
    return held_.use(Gone::comes_back,
                     [&](Camera& device) { return device.set_feature(name, value); });
  }

 private:
  /// What the former opening counted goes to the sums.
  void begin_again(const Camera& device) {
    times_opened_ = held_.times_opened();
    info_ = device.info();
    numbers_before_ = last_number_;
    before_ = {before_.delivered + counted_.delivered, before_.lost + counted_.lost,
               before_.torn + counted_.torn};
    counted_ = {};
  }

  Held<Camera> held_;
  CameraInfo info_;
  int times_opened_ = 1;
  std::uint64_t last_number_ = 0;     // as returned
  std::uint64_t numbers_before_ = 0;  // of all openings before this one
  CameraStatistics counted_;          // since it was opened last
  CameraStatistics before_;           // of all openings before this one
};

/// A new driver begins with nothing pressed or deflected, so nothing is kept from the lost one.
class ReopeningInput final : public OperatorInput {
 public:
  explicit ReopeningInput(Held<OperatorInput> held) : held_(std::move(held)) {}
  std::string identity() const override { return held_.identity(); }
  OperatorState state() override {
    return held_.use(Gone::comes_back, [](OperatorInput& device) { return device.state(); });
  }

 private:
  Held<OperatorInput> held_;
};

}  // namespace

std::unique_ptr<CoilAmplifier> reopening(std::function<std::unique_ptr<CoilAmplifier>()> open,
                                         const ReopeningSettings& settings, const Clock& clock) {
  return std::make_unique<ReopeningAmplifier>(
      Held<CoilAmplifier>(std::move(open), settings, clock));
}
std::unique_ptr<Lamp> reopening(std::function<std::unique_ptr<Lamp>()> open,
                                const ReopeningSettings& settings, const Clock& clock) {
  return std::make_unique<ReopeningLamp>(Held<Lamp>(std::move(open), settings, clock));
}
std::unique_ptr<LensMover> reopening(std::function<std::unique_ptr<LensMover>()> open,
                                     const ReopeningSettings& settings, const Clock& clock) {
  return std::make_unique<ReopeningLensMover>(Held<LensMover>(std::move(open), settings, clock));
}
std::unique_ptr<Camera> reopening(std::function<std::unique_ptr<Camera>()> open,
                                  const ReopeningSettings& settings, const Clock& clock) {
  return std::make_unique<ReopeningCamera>(Held<Camera>(std::move(open), settings, clock));
}
std::unique_ptr<OperatorInput> reopening(std::function<std::unique_ptr<OperatorInput>()> open,
                                         const ReopeningSettings& settings, const Clock& clock) {
  return std::make_unique<ReopeningInput>(Held<OperatorInput>(std::move(open), settings, clock));
}

}  // namespace vitreo
