// Byte link in memory: the wire between a real driver and an emulator.
// SPDX-License-Identifier: Apache-2.0
#include "devices/links/byte_link.h"
#include "devices/links/serial_line.h"
#include "devices/time/error.h"

#include <algorithm>
#include <stdexcept>
#include <utility>

namespace vitreo {
namespace {

/// How often a reader checks whether a test has pulled the cable: faults are set without a signal.
constexpr Time kFaultPoll = std::chrono::milliseconds(50);
/// Bytes that the sending side takes before it makes a writer wait: a kernel's buffer of a port.
constexpr std::size_t kSendBuffer = 4096;

/// Full duplex: bytes arrive in order, each at a time that is known when it is sent, and neither
/// way waits for the other. A writer hands its bytes over and goes on, as with a port of the
/// system's; a task of the link's own gives each to the peer when it has arrived. Where bytes take
/// no time there is no such task, and the writer itself delivers them.
class MemoryByteLink final : public ByteLink {
 public:
  MemoryByteLink(BytePeer& peer, Clock& clock, const MemoryLinkSettings& settings,
                 const LinkFaults* faults)
      : peer_(peer),
        clock_(clock),
        faults_(faults),
        out_(settings.per_byte, settings.latency),
        in_(settings.per_byte, settings.latency) {
    if (settings.per_byte > Time::zero() || settings.latency > Time::zero())
      carrier_ = clock.spawn("wire", [this] { carry(); });
  }
  MemoryByteLink(const MemoryByteLink&) = delete;
  MemoryByteLink& operator=(const MemoryByteLink&) = delete;
  // A port that is closed still sends what it was given.
  ~MemoryByteLink() override {
    if (!carrier_) return;
    const StopShield shield(clock_);
    clock_.wait(
        room_, [this] { return out_.on_the_way() == 0; }, kForever);
  }

  const std::string& address() const override { return address_; }

  void write(std::span<const std::uint8_t> bytes, Time timeout) override {
    check_cable();
    if (carrier_)
      hand_over(bytes, later(clock_.now(), timeout));
    else
      deliver_now(bytes);
    check_cable();
  }

  ByteString read(std::size_t most, Time timeout) override {
    const Time deadline = later(clock_.now(), timeout);
    for (;;) {
      check_cable();
      collect();
      if (ByteString bytes = in_.arrived(clock_.now(), most); !bytes.empty()) return bytes;
      if (clock_.now() >= deadline) return {};
      const std::uint64_t before = deliveries_;
      reader_until_ = wake_up(deadline);
      clock_.wait(
          arrival_, [&] { return deliveries_ != before; }, reader_until_);
    }
  }

  bool hung_up() const override { return faults_ != nullptr && faults_->unplugged; }

  // What was on its way is lost with the connection.
  void reopen() override {
    check_cable();
    collect();
    in_.clear();
    out_.clear();
    clock_.notify(room_);
  }

 private:
  void check_cable() const {
    if (faults_ != nullptr && faults_->unplugged)
      throw DeviceError(DeviceErrorKind::lost, address_, "is gone");
  }

  /// What has no room waits until the line has taken what is before it. Half a command on the wire
  /// would confuse the instrument, so a stop is thrown only when all of it is on its way.
  void hand_over(std::span<const std::uint8_t> bytes, Time deadline) {
    {
      const StopShield shield(clock_);
      while (!bytes.empty()) {
        const auto has_room = [this] { return out_.on_the_way() < kSendBuffer; };
        if (!clock_.wait(room_, has_room, deadline))
          throw DeviceError(DeviceErrorKind::timeout, address_,
                            "it did not take the bytes in time");
        const auto part = bytes.first(std::min(bytes.size(), kSendBuffer - out_.on_the_way()));
        out_.put(part, clock_.now());
        clock_.notify(departure_);
        bytes = bytes.subspan(part.size());
      }
    }
    clock_.sleep_for(Time::zero());
  }

  void deliver_now(std::span<const std::uint8_t> bytes) {
    try {
      clock_.sleep_for(Time::zero());
    } catch (const Stopped&) {
      deliver(bytes);  // what is on the wire arrives, whatever becomes of the sender
      throw;
    }
    deliver(bytes);
  }

  /// The link's own task: each byte to the peer at its time.
  void carry() {
    for (;;) {
      clock_.wait(
          departure_, [this] { return out_.on_the_way() > 0; }, kForever);
      clock_.sleep_until(out_.next());
      // Empty where a new opening has dropped what was on its way.
      if (const ByteString bytes = out_.arrived(clock_.now()); !bytes.empty()) deliver(bytes);
      clock_.notify(room_);
    }
  }

  /// A reader is woken only for what comes before it would look by itself.
  void deliver(std::span<const std::uint8_t> bytes) {
    collect();  // what it sent before is not changed by what it receives now
    const bool arrives = faults_ == nullptr || (!faults_->deaf && !faults_->unplugged);
    if (arrives) peer_.receive(bytes, clock_.now());
    ++deliveries_;
    if (peer_.next() < reader_until_) clock_.notify(arrival_);
  }

  /// Takes what the peer has sent, and puts it on the wire from the moment at which it was sent.
  void collect() {
    for (const TimedBytes& sent : peer_.say(clock_.now())) {
      for (std::uint8_t value : sent.bytes) {
        if (faults_ != nullptr && !survives(value)) continue;
        in_.put({&value, 1}, sent.at, faults_ == nullptr ? Time::zero() : faults_->late);
      }
    }
  }

  /// Applies the faults to one byte; false when it gets lost. `keep` and `garble` count bytes since
  /// they were set.
  bool survives(std::uint8_t& value) {
    if (faults_->silent || faults_->unplugged) return false;
    if (faults_->keep != keep_set_) keep_left_ = keep_set_ = faults_->keep;
    if (faults_->garble != garble_set_) garble_left_ = garble_set_ = faults_->garble;
    if (keep_set_ >= 0 && keep_left_-- <= 0) return false;
    if (garble_set_ >= 0 && garble_left_-- == 0) value ^= faults_->flip;
    return true;
  }

  /// The next time at which a reader may find something: the deadline, a byte, the peer, a fault.
  /// Without faults only a delivery, which notifies, can end the wait earlier.
  Time wake_up(Time deadline) const {
    const Time due = std::min({deadline, peer_.next(), in_.next()});
    return faults_ == nullptr ? due : std::min(due, later(clock_.now(), kFaultPoll));
  }

  const std::string address_ = "emulated";
  BytePeer& peer_;
  Clock& clock_;
  const LinkFaults* const faults_;
  SerialLine out_;
  SerialLine in_;
  int keep_set_ = -1;  // the fault's value, by which a new one is noticed
  int keep_left_ = 0;
  int garble_set_ = -1;
  int garble_left_ = 0;
  std::uint64_t deliveries_ = 0;
  Time reader_until_{};  // when a reader that waits looks again by itself
  Signal arrival_;
  Signal departure_;
  Signal room_;
  std::unique_ptr<Task> carrier_;  // last: it ends before what it uses
};

}  // namespace

std::unique_ptr<ByteLink> memory_byte_link(BytePeer& peer, Clock& clock,
                                           const MemoryLinkSettings& settings,
                                           const LinkFaults* faults) {
  return std::make_unique<MemoryByteLink>(peer, clock, settings, faults);
}

}  // namespace vitreo
