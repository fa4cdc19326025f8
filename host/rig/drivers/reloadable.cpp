// SPDX-License-Identifier: Apache-2.0
#include "host/rig/drivers/reloadable.h"

#include "devices/time/error.h"

#include <algorithm>
#include <memory>
#include <utility>
#include <vector>

namespace vitreo {
namespace {

/// What all proxies share: the driver inside, how many calls are on it, and its exchange. What
/// holds the role has borrowed the proxy, whose address stays while the driver is another one.
template <class Role>
class Proxy : public Role, public Reloadable {
 public:
  Proxy(ReloadableDriver<Role> driver, const RigContext& where)
      : driver_(std::move(driver)), where_(where), opened_(driver_.first.opener(where)) {}

  // What is wrong with the file shows before anything of the old driver is touched.
  RigSource reload() override {
    DriverReading<Role> next = driver_.again();
    if (uses_ > 0) fail(DeviceErrorKind::refused, "it is at work: wait until that has ended");
    // Two links to one instrument cannot be: the old one is closed before the new one is opened.
    const StopShield shield(where_.clock);
    const bool safe = !opened_.device || made_safe();
    close();
    try {
      open(next);
      // The old driver could not reach its safe state: the new one does, before it counts as
      // opened.
      if (!safe) make_driver_safe();
    } catch (const DeviceError& error) {
      go_back(error);
    } catch (const std::exception& error) {
      go_back(DeviceError(DeviceErrorKind::refused, driver_.role, error.what()));
    }
    driver_.first = std::move(next);
    return driver_.first.file;
  }
  bool in_use() override { return false; }

 protected:
  /// One call on the driver; while there is one it is not exchanged.
  class Use {
   public:
    explicit Use(const Proxy& proxy) : proxy_(proxy) {
      if (!proxy.opened_.device)
        proxy.fail(DeviceErrorKind::lost, "is closed, for its reload failed; rig:reload(\"" +
                                              proxy.driver_.role + "\") opens it again");
      ++proxy.uses_;
    }
    ~Use() { --proxy_.uses_; }
    Use(const Use&) = delete;
    Use& operator=(const Use&) = delete;
    Role* operator->() const { return proxy_.opened_.device.get(); }

   private:
    const Proxy& proxy_;
  };

  /// After each opening: refuses, by DeviceError, what those who hold the proxy could not follow.
  virtual void take_over(Role& driver) = 0;
  bool has_safe_state() const { return driver_.first.has_safe_state; }
  Role* driver() const { return opened_.device.get(); }
  [[noreturn]] void fail(DeviceErrorKind kind, const std::string& what) const {
    throw DeviceError(kind, driver_.role, what);
  }
  [[noreturn]] void refuse_change(const std::string& what) const {
    fail(DeviceErrorKind::refused, "its " + what + ": that takes a rig that is opened anew");
  }

 private:
  void open(const DriverReading<Role>& reading) {
    opened_ = reading.opener(where_);
    take_over(*opened_.device);
  }

  /// The driver's end first: it still talks to its emulator.
  void close() {
    opened_.device.reset();
    opened_.far_end.reset();
  }

  void make_driver_safe() {
    if constexpr (requires(Role & role) { role.make_safe(); }) opened_.device->make_safe();
  }

  /// A driver whose file is what has to be mended may fail in this too; the new one does it then.
  bool made_safe() {
    try {
      make_driver_safe();
      return true;
    } catch (const DeviceError&) {
      return false;
    }
  }

  [[noreturn]] void go_back(const DeviceError& error) {
    std::string outcome = "; as it was before it is open again";
    close();
    try {
      open(driver_.first);
    } catch (const std::exception& second) {
      close();
      outcome = std::string("; as it was before it does not open either: ") + second.what();
    }
    throw DeviceError(error.kind, error.device, error.text + outcome);
  }

  ReloadableDriver<Role> driver_;
  const RigContext where_;
  Opened<Role> opened_;
  // Tasks take turns under the clock's one baton, so a plain count is enough.
  mutable int uses_ = 0;
};

class InstrumentProxy final : public Proxy<Instrument> {
 public:
  InstrumentProxy(ReloadableDriver<Instrument> of, const RigContext& where)
      : Proxy(std::move(of), where) {
    take_over(*driver());
  }
  const InstrumentInfo& info() const override { return info_; }
  QuantitySample read(std::size_t index, Time timeout) override {
    return Use(*this)->read(index, timeout);
  }
  void set(std::size_t index, const QuantityValue& value) override {
    const Use use(*this);
    touched_ = true;
    use->set(index, value);
  }
  void command(std::size_t index, const std::vector<QuantityValue>& arguments) override {
    const Use use(*this);
    touched_ = true;
    use->command(index, arguments);
  }
  Latest latest(std::size_t index) const override {
    return driver() == nullptr ? Latest{} : driver()->latest(index);
  }
  void on_poll(PollListener listener) override {
    listener_ = std::move(listener);
    if (driver() != nullptr) driver()->on_poll(listener_);
  }
  void make_safe() override {
    Use(*this)->make_safe();
    touched_ = false;
  }
  bool in_use() override { return touched_ && has_safe_state(); }

 private:
  void take_over(Instrument& now) override {
    if (!info_.kind.empty() && info_.kind != now.info().kind)
      refuse_change("kind was " + info_.kind + " and is " + now.info().kind);
    info_ = now.info();
    touched_ = false;
    // The record's listener is the proxy's: each new driver is given it.
    now.on_poll(listener_);
  }

  // A copy, so that what scripts hold of it does not end with the driver.
  InstrumentInfo info_;
  PollListener listener_;
  bool touched_ = false;  // set or commanded since it was last made safe
};

/// What Stage and RotationStage share.
template <class Role>
class MotionProxy : public Proxy<Role> {
 public:
  using Proxy<Role>::Proxy;
  using Use = typename Proxy<Role>::Use;
  bool moving() override { return Use(*this)->moving(); }
  void wait(Time timeout) override { Use(*this)->wait(timeout); }
  void home(Time timeout) override { Use(*this)->home(timeout); }
  void stop() override { Use(*this)->stop(); }
  void make_safe() override { Use(*this)->make_safe(); }
  bool in_use() override {
    try {
      return this->driver() != nullptr && this->driver()->moving();
    } catch (const DeviceError&) {  // that it is gone is no reason to keep its driver
      return false;
    }
  }
};

class StageProxy final : public MotionProxy<Stage> {
 public:
  StageProxy(ReloadableDriver<Stage> of, const RigContext& where)
      : MotionProxy(std::move(of), where) {
    take_over(*driver());
  }
  const StageInfo& info() const override { return info_; }
  std::vector<double> position() override { return Use(*this)->position(); }
  void start(std::span<const double> target, double speed) override {
    Use(*this)->start(target, speed);
  }

 private:
  void take_over(Stage& now) override {
    const auto& axes = now.info().axes;
    const bool same = info_.axes.empty() ||
                      std::equal(axes.begin(), axes.end(), info_.axes.begin(), info_.axes.end(),
                                 [](const auto& a, const auto& b) { return a.name == b.name; });
    if (!same) refuse_change("axes are others");
    info_ = now.info();
  }
  StageInfo info_;
};

class RotationStageProxy final : public MotionProxy<RotationStage> {
 public:
  RotationStageProxy(ReloadableDriver<RotationStage> of, const RigContext& where)
      : MotionProxy(std::move(of), where) {
    take_over(*driver());
  }
  const RotationStageInfo& info() const override { return info_; }
  double position() override { return Use(*this)->position(); }
  void start(double target, double speed) override { Use(*this)->start(target, speed); }

 private:
  void take_over(RotationStage& now) override { info_ = now.info(); }
  RotationStageInfo info_;
};

class LensMoverProxy final : public Proxy<LensMover> {
 public:
  using Proxy::Proxy;
  std::string identity() const override { return Use(*this)->identity(); }
  double position() const override { return Use(*this)->position(); }
  void move_to(double position, Time timeout) override { Use(*this)->move_to(position, timeout); }
  double travel_min() const override { return Use(*this)->travel_min(); }
  double travel_max() const override { return Use(*this)->travel_max(); }
  bool homed() const override { return Use(*this)->homed(); }
  void home(Time timeout) override { Use(*this)->home(timeout); }
  void make_safe() override { Use(*this)->make_safe(); }

 private:
  void take_over(LensMover&) override {}
};

class FieldProbeProxy final : public Proxy<FieldProbe> {
 public:
  FieldProbeProxy(ReloadableDriver<FieldProbe> of, const RigContext& where)
      : Proxy(std::move(of), where), info_(driver()->info()) {}
  const FieldProbeInfo& info() const override { return info_; }
  FieldReading measure(Time timeout) override { return Use(*this)->measure(timeout); }

 private:
  void take_over(FieldProbe& now) override {
    if (now.info().axes != info_.axes) refuse_change("axes are others");
    info_ = now.info();
  }
  FieldProbeInfo info_;
};

class CurrentSensorProxy final : public Proxy<CurrentSensor> {
 public:
  CurrentSensorProxy(ReloadableDriver<CurrentSensor> of, const RigContext& where)
      : Proxy(std::move(of), where), info_(driver()->info()) {}
  const CurrentSensorInfo& info() const override { return info_; }
  std::vector<double> measure(Time timeout) override { return Use(*this)->measure(timeout); }

 private:
  void take_over(CurrentSensor& now) override {
    if (now.info().coils != info_.coils) refuse_change("coils are others");
    info_ = now.info();
  }
  CurrentSensorInfo info_;
};

// Not while a current may flow: the interlock, which knows, is asked before
// (host/rig/open_rig.cpp).
class CoilsProxy final : public Proxy<CoilAmplifier> {
 public:
  CoilsProxy(ReloadableDriver<CoilAmplifier> of, const RigContext& where)
      : Proxy(std::move(of), where),
        channels_(driver()->channels()),
        limit_(driver()->current_limit()) {}
  std::string identity() const override { return Use(*this)->identity(); }
  int channels() const override { return channels_; }
  double current_limit() const override { return limit_; }
  void set_currents(std::span<const double> currents) override {
    Use(*this)->set_currents(currents);
  }
  std::vector<double> currents() const override {
    return driver() == nullptr ? std::vector<double>(static_cast<std::size_t>(channels_), 0)
                               : driver()->currents();
  }
  std::optional<std::vector<double>> measured_currents() override {
    return Use(*this)->measured_currents();
  }
  void make_safe() override { Use(*this)->make_safe(); }

 private:
  void take_over(CoilAmplifier& now) override {
    if (now.channels() != channels_) refuse_change("channels are others");
    limit_ = now.current_limit();
  }
  const int channels_;
  double limit_;
};

class LampProxy final : public Proxy<Lamp> {
 public:
  using Proxy::Proxy;
  std::string identity() const override { return Use(*this)->identity(); }
  void set_level(double level) override { Use(*this)->set_level(level); }
  double level() const override { return driver() == nullptr ? 0 : driver()->level(); }
  void ask() override { Use(*this)->ask(); }
  void make_safe() override { Use(*this)->make_safe(); }
  bool in_use() override { return level() > 0; }

 private:
  void take_over(Lamp&) override {}
};

template <class Role, class Its>
Opened<Role> opened_proxy(ReloadableDriver<Role> driver, const RigContext& where) {
  const std::string role = driver.role;
  auto proxy = std::make_unique<Its>(std::move(driver), where);
  // Borrowed: the rig owns the proxy, and its table of reloadable roles lives no longer.
  if (where.reloadable != nullptr) (*where.reloadable)[role] = proxy.get();
  return {nullptr, std::move(proxy)};
}

}  // namespace

template <>
Opened<Instrument> open_reloadable(ReloadableDriver<Instrument> driver, const RigContext& where) {
  return opened_proxy<Instrument, InstrumentProxy>(std::move(driver), where);
}
template <>
Opened<Stage> open_reloadable(ReloadableDriver<Stage> driver, const RigContext& where) {
  return opened_proxy<Stage, StageProxy>(std::move(driver), where);
}
template <>
Opened<RotationStage> open_reloadable(ReloadableDriver<RotationStage> driver,
                                      const RigContext& where) {
  return opened_proxy<RotationStage, RotationStageProxy>(std::move(driver), where);
}
template <>
Opened<LensMover> open_reloadable(ReloadableDriver<LensMover> driver, const RigContext& where) {
  return opened_proxy<LensMover, LensMoverProxy>(std::move(driver), where);
}
template <>
Opened<FieldProbe> open_reloadable(ReloadableDriver<FieldProbe> driver, const RigContext& where) {
  return opened_proxy<FieldProbe, FieldProbeProxy>(std::move(driver), where);
}
template <>
Opened<CurrentSensor> open_reloadable(ReloadableDriver<CurrentSensor> driver,
                                      const RigContext& where) {
  return opened_proxy<CurrentSensor, CurrentSensorProxy>(std::move(driver), where);
}
template <>
Opened<CoilAmplifier> open_reloadable(ReloadableDriver<CoilAmplifier> driver,
                                      const RigContext& where) {
  return opened_proxy<CoilAmplifier, CoilsProxy>(std::move(driver), where);
}
template <>
Opened<Lamp> open_reloadable(ReloadableDriver<Lamp> driver, const RigContext& where) {
  return opened_proxy<Lamp, LampProxy>(std::move(driver), where);
}

}  // namespace vitreo
