// Faults on the instrument's side of a real link, where the host's end is out of reach: decorators
// of the emulators.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/byte_link.h"
#include "devices/links/hid_link.h"
#include "devices/links/usb_link.h"

#include <atomic>
#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <span>
#include <vector>

namespace vitreo {

/// Cuts one report or answer short (keep), or changes one of its bytes (garble).
void spoil(const LinkFaults& faults, std::vector<std::uint8_t>& bytes);

/// Of a serial line or a connection. `unplugged` is the wire's own and not used here.
struct LineFaults : LinkFaults {
  bool echo = false;  ///< the line sends back what it is sent
  bool off = false;   ///< the instrument is without power: it hears and says nothing
};

/// keep and garble count the bytes since the last question.
class FaultyBytePeer final : public BytePeer {
 public:
  explicit FaultyBytePeer(std::shared_ptr<BytePeer> instrument)
      : instrument_(std::move(instrument)) {}
  LineFaults& faults() { return faults_; }
  /// Whether the host has sent anything yet. Any thread.
  bool touched() const { return touched_; }
  /// The other line has this one's instrument from now on, and this one the other's.
  void exchange(FaultyBytePeer& other) { std::swap(instrument_, other.instrument_); }

  void receive(std::span<const std::uint8_t> bytes, Time now) override;
  std::vector<TimedBytes> say(Time now) override;
  Time next() const override;
  void power_cycle(Time now) override { instrument_->power_cycle(now); }

 private:
  void collect(Time now);
  void put(Time at, ByteString bytes);

  std::shared_ptr<BytePeer> instrument_;
  LineFaults faults_;
  std::atomic<bool> touched_{false};
  int answered_ = 0;               // bytes since the last question
  std::deque<TimedBytes> coming_;  // in the order of their arrival
};

/// Reports that are late wait for serve(). Not safe for several threads at a time, but touched().
class FaultyHidPeer final : public HidPeer {
 public:
  /// `instrument` and `clock` outlive it.
  FaultyHidPeer(HidPeer& instrument, const Clock& clock) : instrument_(instrument), clock_(clock) {}
  LinkFaults& faults() { return faults_; }
  bool touched() const { return touched_; }
  /// Sends the late reports whose time has come.
  void serve();

  std::vector<std::vector<std::uint8_t>> receive(std::span<const std::uint8_t> report) override;
  void connect(const Send& send) override;
  void power_cycle() override { instrument_.power_cycle(); }

 private:
  struct Late {
    Time due;
    std::vector<std::uint8_t> report;
  };
  std::optional<std::vector<std::uint8_t>> passed(std::vector<std::uint8_t> report);

  HidPeer& instrument_;
  const Clock& clock_;
  LinkFaults faults_;
  std::atomic<bool> touched_{false};
  Send send_;
  std::deque<Late> late_;
};

/// Answers cut short or garbled. What never answers, or late, is the bus' own (UsbTestbed): a
/// transfer has one end.
class FaultyUsbPeer final : public UsbPeer {
 public:
  explicit FaultyUsbPeer(UsbPeer& instrument) : instrument_(instrument) {}
  LinkFaults& faults() { return faults_; }
  bool touched() const { return touched_; }

  const UsbIdentity& identity() const override { return instrument_.identity(); }
  std::optional<std::vector<std::uint8_t>> control(const UsbSetup& setup,
                                                   std::span<const std::uint8_t> data,
                                                   std::uint16_t length) override;
  void power_cycle() override { instrument_.power_cycle(); }

 private:
  UsbPeer& instrument_;
  LinkFaults faults_;
  std::atomic<bool> touched_{false};
};

}  // namespace vitreo
