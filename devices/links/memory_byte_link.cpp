// Byte link in memory: the wire between a real driver and an emulator.
// SPDX-License-Identifier: Apache-2.0
#include "devices/links/byte_link.h"
#include "devices/time/error.h"

#include <algorithm>
#include <deque>
#include <stdexcept>
#include <utility>

namespace vitreo {
namespace {

/// How often a reader checks whether a test has pulled the cable: faults are set without a signal.
constexpr Time kFaultPoll = std::chrono::milliseconds(50);

/// Bytes arrive in order, each at a time that is known when it is sent; a reader sleeps until then.
/// The peer is driven by the caller: at each read and write it is given the time and asked for what
/// it has sent.
/// Bytes that are on their way are in coming_, in the order of their arrival.
class MemoryByteLink final : public ByteLink {
 public:
  MemoryByteLink(BytePeer& peer, Clock& clock, const MemoryLinkSettings& settings,
                 const LinkFaults* faults)
      : peer_(peer), clock_(clock), settings_(settings), faults_(faults) {
    if (settings.latency < Time::zero())
      throw std::invalid_argument("latency: must not be negative");
    if (settings.per_byte < Time::zero())
      throw std::invalid_argument("per_byte: must not be negative");
  }

  const std::string& address() const override { return address_; }

  void write(std::span<const std::uint8_t> bytes, Time timeout) override {
    check_cable();
    // A line of that baud rate is busy for as long as its bytes take; then they have arrived.
    const Time needed =
        settings_.latency + settings_.per_byte * static_cast<std::int64_t>(bytes.size());
    if (needed > timeout) {
      clock_.sleep_for(timeout);
      throw DeviceError(DeviceErrorKind::timeout, address_, "it did not take the bytes in time");
    }
    try {
      clock_.sleep_for(needed);
    } catch (const Stopped&) {
      deliver(bytes);  // what is on the wire arrives, whatever becomes of the sender
      throw;
    }
    check_cable();
    deliver(bytes);
  }

  ByteString read(std::size_t most, Time timeout) override {
    const Time deadline = later(clock_.now(), timeout);
    for (;;) {
      check_cable();
      collect();
      if (ByteString bytes = arrived(most); !bytes.empty()) return bytes;
      if (clock_.now() >= deadline) return {};
      const std::uint64_t before = deliveries_;
      clock_.wait(
          arrival_, [&] { return deliveries_ != before; }, wake_up(deadline));
    }
  }

  // What was on its way is lost with the connection.
  void reopen() override {
    check_cable();
    collect();
    coming_.clear();
  }

 private:
  struct Byte {
    Time due;
    std::uint8_t value;
  };

  void check_cable() const {
    if (faults_ != nullptr && faults_->unplugged)
      throw DeviceError(DeviceErrorKind::lost, address_, "is gone");
  }

  void deliver(std::span<const std::uint8_t> bytes) {
    collect();  // what it sent before is not changed by what it receives now
    if (faults_ == nullptr || !faults_->deaf) peer_.receive(bytes, clock_.now());
    ++deliveries_;
    clock_.notify(arrival_);
  }

  /// Takes what the peer has sent, and gives each byte the time of its arrival: the latency once,
  /// then one byte's time after the other, as on a line of that baud rate.
  void collect() {
    for (const TimedBytes& sent : peer_.say(clock_.now())) {
      for (const std::uint8_t value : sent.bytes) {
        Byte byte{later(sent.at, settings_.latency), value};
        if (faults_ != nullptr && !survives(byte)) continue;
        if (!coming_.empty()) byte.due = std::max(byte.due, coming_.back().due);
        byte.due += settings_.per_byte;
        coming_.push_back(byte);
      }
    }
  }

  /// Applies the faults to one byte; false when it gets lost. `keep` and `garble` count bytes since
  /// they were set.
  bool survives(Byte& byte) {
    if (faults_->silent || faults_->unplugged) return false;
    if (faults_->keep != keep_set_) keep_left_ = keep_set_ = faults_->keep;
    if (faults_->garble != garble_set_) garble_left_ = garble_set_ = faults_->garble;
    if (keep_set_ >= 0 && keep_left_-- <= 0) return false;
    if (garble_set_ >= 0 && garble_left_-- == 0) byte.value ^= faults_->flip;
    byte.due = later(byte.due, faults_->late);
    return true;
  }

  /// Takes what has arrived up to now.
  ByteString arrived(std::size_t most) {
    ByteString bytes;
    while (!coming_.empty() && coming_.front().due <= clock_.now() && bytes.size() < most) {
      bytes.push_back(coming_.front().value);
      coming_.pop_front();
    }
    return bytes;
  }

  /// The next time at which a reader may find something: the deadline, a byte, the peer, a fault.
  /// Without faults only a delivery, which notifies, can end the wait earlier.
  Time wake_up(Time deadline) const {
    Time due = std::min(deadline, peer_.next());
    if (!coming_.empty()) due = std::min(due, coming_.front().due);
    if (faults_ != nullptr) due = std::min(due, later(clock_.now(), kFaultPoll));
    return due;
  }

  const std::string address_ = "emulated";
  BytePeer& peer_;
  Clock& clock_;
  const MemoryLinkSettings settings_;
  const LinkFaults* const faults_;
  int keep_set_ = -1;  // the fault's value, by which a new one is noticed
  int keep_left_ = 0;
  int garble_set_ = -1;
  int garble_left_ = 0;
  std::deque<Byte> coming_;
  std::uint64_t deliveries_ = 0;
  Signal arrival_;
};

}  // namespace

std::unique_ptr<ByteLink> memory_byte_link(BytePeer& peer, Clock& clock,
                                           const MemoryLinkSettings& settings,
                                           const LinkFaults* faults) {
  return std::make_unique<MemoryByteLink>(peer, clock, settings, faults);
}

}  // namespace vitreo
