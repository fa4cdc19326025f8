// Message link in memory: the wire between a real driver and an emulator.
// SPDX-License-Identifier: Apache-2.0
#include "devices/links/faulty_peers.h"
#include "devices/links/message_link.h"
#include "devices/time/error.h"

#include <algorithm>
#include <deque>
#include <stdexcept>
#include <utility>

namespace vitreo {
namespace {

/// How often a reader checks whether a test has pulled the cable: faults are set without a signal.
constexpr Time kCableCheck = std::chrono::milliseconds(50);

/// Messages keep their order and their boundaries.
class MemoryMessageLink final : public MessageLink {
 public:
  MemoryMessageLink(MessagePeer& peer, Clock& clock, Time latency, const LinkFaults* faults)
      : peer_(peer), clock_(clock), latency_(latency), faults_(faults) {
    if (latency < Time::zero()) throw std::invalid_argument("latency: must not be negative");
  }

  const std::string& address() const override { return address_; }

  // The caller's task waits for the message's way; stopping it does not stop the message.
  void write(std::span<const std::uint8_t> message, Time timeout) override {
    check_cable();
    try {
      clock_.sleep_for(std::min(latency_, timeout));
    } catch (const Stopped&) {
      deliver(message);
      throw;
    }
    check_cable();
    if (latency_ > timeout)
      throw DeviceError(DeviceErrorKind::timeout, address_, "it did not take the message in time");
    deliver(message);
  }

  std::optional<ByteString> read(std::size_t most, Time timeout) override {
    const Time deadline = later(clock_.now(), timeout);
    for (;;) {
      check_cable();
      collect();
      if (!coming_.empty() && coming_.front().at <= clock_.now()) return take(most);
      if (clock_.now() >= deadline) return std::nullopt;
      const std::uint64_t before = deliveries_;
      clock_.wait(
          arrival_, [&] { return deliveries_ != before; }, wake_up(deadline));
    }
  }

  void clear(Time timeout) override {
    check_cable();
    clock_.sleep_for(std::min(latency_, timeout));
    check_cable();
    collect();
    coming_.clear();
    if (arrives()) peer_.clear(clock_.now());
  }

  void reopen() override {
    check_cable();
    collect();
    coming_.clear();
  }

 private:
  void check_cable() const {
    if (faults_ != nullptr && faults_->unplugged)
      throw DeviceError(DeviceErrorKind::lost, address_, "is gone");
  }
  bool arrives() const { return faults_ == nullptr || (!faults_->deaf && !faults_->unplugged); }

  void deliver(std::span<const std::uint8_t> message) {
    collect();  // what it sent before is not changed by what it receives now
    if (arrives()) peer_.receive(message, clock_.now());
    ++deliveries_;
    clock_.notify(arrival_);
  }

  /// Takes what the peer has sent, and puts it on the wire from the moment at which it was sent.
  void collect() {
    for (TimedMessage& sent : peer_.say(clock_.now())) {
      Time due = later(sent.at, latency_);
      if (faults_ != nullptr) {
        if (faults_->silent || faults_->unplugged) continue;
        spoil(*faults_, sent.bytes);
        due = later(due, faults_->late);
      }
      if (!coming_.empty()) due = std::max(due, coming_.back().at);
      coming_.push_back({due, std::move(sent.bytes)});
    }
  }

  ByteString take(std::size_t most) {
    ByteString message = std::move(coming_.front().bytes);
    coming_.pop_front();
    if (message.size() > most)
      throw DeviceError(DeviceErrorKind::protocol, address_,
                        "a message of " + std::to_string(message.size()) + " bytes, more than " +
                            std::to_string(most));
    return message;
  }

  /// The next time at which a reader may find something.
  Time wake_up(Time deadline) const {
    // What the peer had said by now is in coming_ already.
    const Time due =
        std::min({deadline, peer_.next(), coming_.empty() ? kForever : coming_.front().at});
    return faults_ == nullptr ? due : std::min(due, later(clock_.now(), kCableCheck));
  }

  const std::string address_ = "emulated";
  MessagePeer& peer_;
  Clock& clock_;
  const Time latency_;
  const LinkFaults* const faults_;
  std::deque<TimedMessage> coming_;  // in the order of their arrival
  std::uint64_t deliveries_ = 0;
  Signal arrival_;
};

}  // namespace

std::unique_ptr<MessageLink> memory_message_link(MessagePeer& peer, Clock& clock, Time latency,
                                                 const LinkFaults* faults) {
  return std::make_unique<MemoryMessageLink>(peer, clock, latency, faults);
}

}  // namespace vitreo
