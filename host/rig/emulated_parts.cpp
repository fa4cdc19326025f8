// SPDX-License-Identifier: Apache-2.0
#include "host/rig/emulated_parts.h"

#include "devices/links/faulty_peers.h"

#include <cmath>
#include <limits>
#include <memory>
#include <mutex>
#include <utility>

namespace vitreo {
namespace {

/// The faults that all wires have in common; -1: whole answers, unchanged.
void set_wire(LinkFaults& faults, const std::string& kind, double by, bool on) {
  const int count = on ? static_cast<int>(by) : -1;
  if (kind == "silent") faults.silent = on;
  if (kind == "deaf") faults.deaf = on;
  if (kind == "late") faults.late = on ? from_seconds(by) : Time(0);
  if (kind == "short") faults.keep = count;
  if (kind == "garbled") faults.garble = count;
}

class Line final : public EmulatedPart {
 public:
  Line(EmulatedWorld& world, std::unique_ptr<PeerEnd> opened, Plug plug,
       std::shared_ptr<BytePeer> instrument)
      : world_(world),
        plug_(std::move(plug)),
        line_(std::move(instrument)),
        wire_(std::move(opened)) {}

  const char* type() const override { return "line"; }
  bool touched() const override { return line_.touched(); }
  Time transfer(Time now) override {
    const auto there = wire();
    if (!there) return kForever;
    there->transfer(now);
    return there->next();
  }
  void serve(Time now) override {
    if (const auto there = wire()) there->exchange(line_, now);
  }
  void set(const Fault& fault, double by, bool on) override {
    if (fault.kind == "unplugged") return world_.in_turn([&] { on ? pull() : plug_in(); });
    world_.with([&] {
      set_wire(line_.faults(), fault.kind, by, on);
      if (fault.kind == "echo") line_.faults().echo = on;
      if (fault.kind != "power_cycled") return;
      line_.faults().off = on;
      if (on) line_.power_cycle(world_.clock().now());
    });
  }
  void exchange(EmulatedPart& other) override {
    world_.with([&] { line_.exchange(dynamic_cast<Line&>(other).line_); });
  }

 private:
  void pull() {
    if (!wire()) return;
    set_wire_end(nullptr);
    plug_.pulled();
  }
  void plug_in() {
    if (!wire()) set_wire_end(plug_.open());
  }
  std::shared_ptr<PeerEnd> wire() const {
    const std::lock_guard lock(mutex_);
    return wire_;
  }
  void set_wire_end(std::shared_ptr<PeerEnd> wire) {
    const std::lock_guard lock(mutex_);
    wire_ = std::move(wire);
  }

  EmulatedWorld& world_;
  const Plug plug_;
  FaultyBytePeer line_;
  mutable std::mutex mutex_;  // of wire_, never held while it works
  // Shared with the call under way of another thread, which may outlast the plug. Null: unplugged.
  std::shared_ptr<PeerEnd> wire_;
};

/// What USB and HID devices have in common: a plug.
class OnBus : public EmulatedPart {
 public:
  explicit OnBus(EmulatedWorld& world) : world_(world) {}
  void set(const Fault& fault, double by, bool on) override {
    const bool power = fault.kind == "power_cycled";
    if (fault.kind != "unplugged" && !power) return set_on_bus(fault, by, on);
    world_.in_turn([&] { on ? pull(power) : plug_in(); });
  }

 protected:
  static constexpr int kUnplugged = 0;
  void plug_in() {
    if (plug_ != kUnplugged) return;
    plug_ = plugged();
    after_plug();
  }

  EmulatedWorld& world_;
  int plug_ = kUnplugged;

 private:
  /// The testbed's plug of the device, which appears.
  virtual int plugged() = 0;
  virtual void after_plug() {}
  virtual bool lives_on_bus() const = 0;
  virtual void power_cycle() = 0;
  virtual void set_on_bus(const Fault& fault, double by, bool on) = 0;

  void pull(bool power) {
    if (plug_ == kUnplugged) return;
    world_.testbed().unplug(std::exchange(plug_, kUnplugged));
    if (power || lives_on_bus()) world_.testbed().with_emulators([this] { power_cycle(); });
  }
};

class Usb final : public OnBus {
 public:
  Usb(EmulatedWorld& world, UsbPeer& instrument, Time frame)
      : OnBus(world), peer_(instrument), frame_(frame) {
    plug_in();
  }
  ~Usb() override {
    if (plug_ != kUnplugged) world_.testbed().unplug(plug_);
  }
  Usb(const Usb&) = delete;
  Usb& operator=(const Usb&) = delete;
  const char* type() const override { return "usb"; }
  bool touched() const override { return peer_.touched(); }

 private:
  int plugged() override { return world_.testbed().plug(peer_, frame_); }
  bool lives_on_bus() const override { return false; }  // the motor's supply feeds it
  void power_cycle() override { peer_.power_cycle(); }
  void after_plug() override {
    world_.testbed().set_fault(plug_, silent_ ? UsbFault::silent : UsbFault::none);
    world_.testbed().set_latency(plug_, late_);
  }
  void set_on_bus(const Fault& fault, double by, bool on) override {
    world_.with([&] { set_wire(peer_.faults(), fault.kind, by, on); });
    if (fault.kind == "silent") silent_ = on;
    if (fault.kind == "late") late_ = on ? from_seconds(by) : Time(0);
    if (plug_ != kUnplugged) world_.in_turn([this] { after_plug(); });
  }

  FaultyUsbPeer peer_;
  const Time frame_;
  bool silent_ = false;
  Time late_{};
};

class Hid final : public OnBus {
 public:
  Hid(EmulatedWorld& world, HidPeer& instrument, UsbIdentity identity, const HidUsage& usage,
      Time frame)
      : OnBus(world),
        peer_(instrument, world.clock()),
        identity_(std::move(identity)),
        usage_(usage),
        frame_(frame) {
    plug_in();
  }
  ~Hid() override {
    if (plug_ != kUnplugged) world_.testbed().unplug(plug_);
  }
  Hid(const Hid&) = delete;
  Hid& operator=(const Hid&) = delete;
  const char* type() const override { return "hid"; }
  bool touched() const override { return peer_.touched(); }
  void serve(Time) override { peer_.serve(); }

 private:
  int plugged() override {
    return world_.testbed().plug(peer_, identity_, usage_.page, usage_.usage, frame_);
  }
  void after_plug() override {
    world_.testbed().set_fault(plug_, blocked_ ? UsbFault::stuck : UsbFault::none);
  }
  bool lives_on_bus() const override { return true; }
  void power_cycle() override { peer_.power_cycle(); }
  void set_on_bus(const Fault& fault, double by, bool on) override {
    if (fault.kind != "blocked")
      return world_.with([&] { set_wire(peer_.faults(), fault.kind, by, on); });
    blocked_ = on;
    if (plug_ != kUnplugged) world_.in_turn([this] { after_plug(); });
  }

  FaultyHidPeer peer_;
  const UsbIdentity identity_;
  const HidUsage usage_;
  const Time frame_;
  bool blocked_ = false;
};

class Motor final : public EmulatedPart {
 public:
  Motor(EmulatedWorld& world, std::string role) : world_(world), role_(std::move(role)) {}
  const char* type() const override { return role_ == "lens_mover" ? "lens motor" : "motor"; }
  void set(const Fault& fault, double, bool on) override {
    world_.with([&] {
      sim::Faults& faults = world_.laboratory().faults();
      if (role_ != "lens_mover") return faults.sticks.at(role_)(on, world_.clock().now());
      (fault.kind == "stuck" ? faults.lens.stuck : faults.lens.limit) = on;
      world_.laboratory().apply_lens_faults();
    });
  }

 private:
  EmulatedWorld& world_;
  const std::string role_;
};

/// Between the outputs and the coils.
class Amplifiers final : public EmulatedPart {
 public:
  explicit Amplifiers(EmulatedWorld& world) : world_(world) {}
  const char* type() const override { return "amplifiers"; }
  void set(const Fault& fault, double by, bool on) override {
    world_.with([&] {
      sim::Faults& faults = world_.laboratory().faults();
      if (fault.kind == "saturated")
        faults.saturation = on ? by : std::numeric_limits<double>::infinity();
      else
        cut_off(faults, fault.channel, on);
      world_.laboratory().apply_coil_faults();
    });
  }

 private:
  void cut_off(sim::Faults& faults, const std::optional<int>& channel, bool on) {
    const Time now = world_.clock().now();
    const int coils = static_cast<int>(world_.laboratory().coils(now).set_points.size());
    for (int one = 1; one <= coils; ++one) {
      if (channel && one != *channel) continue;
      if (on)
        faults.cut_off.insert(one);
      else
        faults.cut_off.erase(one);
    }
  }

  EmulatedWorld& world_;
};

}  // namespace

std::unique_ptr<EmulatedPart> make_line(EmulatedWorld& world, std::unique_ptr<PeerEnd> opened,
                                        Plug plug, std::shared_ptr<BytePeer> instrument) {
  return std::make_unique<Line>(world, std::move(opened), std::move(plug), std::move(instrument));
}
std::unique_ptr<EmulatedPart> make_usb(EmulatedWorld& world, UsbPeer& instrument, Time frame) {
  return std::make_unique<Usb>(world, instrument, frame);
}
std::unique_ptr<EmulatedPart> make_hid(EmulatedWorld& world, HidPeer& instrument,
                                       const UsbIdentity& identity, const HidUsage& usage,
                                       Time frame) {
  return std::make_unique<Hid>(world, instrument, identity, usage, frame);
}
std::unique_ptr<EmulatedPart> make_motor(EmulatedWorld& world, const std::string& role) {
  return std::make_unique<Motor>(world, role);
}
std::unique_ptr<EmulatedPart> make_amplifiers(EmulatedWorld& world) {
  return std::make_unique<Amplifiers>(world);
}

}  // namespace vitreo
