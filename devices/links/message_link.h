// Message link: carries whole messages, each of which arrives whole or not at all, to an instrument
// (UDP, USBTMC, VXI-11, HiSLIP) or an emulator; the driver never learns which.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/byte_link.h"
#include "devices/time/clock.h"

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace vitreo {

class MessageLink {
 public:
  virtual ~MessageLink() = default;
  virtual const std::string& address() const = 0;  ///< as in the rig file
  /// The address with what the opening learnt, for errors.
  virtual std::string description() const { return address(); }
  /// One message, or DeviceError{timeout} where the instrument does not take it, {lost}, {refused},
  /// {out_of_range} for one that is too long for the bus: then nothing was sent. Stopped, but only
  /// once it is on its way, so that a stopped task can still stop its instrument.
  virtual void write(std::span<const std::uint8_t> message, Time timeout) = 0;
  /// The next message. Nothing when none was there, whole, within `timeout`; what came of one is
  /// kept for the next call. One of more than `most` bytes is dropped: DeviceError{protocol}.
  /// Throws {lost}, {refused}, Stopped.
  virtual std::optional<ByteString> read(std::size_t most, Time timeout) = 0;
  /// Drops what is on its way, either way, and what the instrument was about to say: a "device
  /// clear" on buses that have one. After an answer that did not come. Throws DeviceError{timeout},
  /// {lost}.
  virtual void clear(Time timeout) = 0;
  /// Closes it, and opens it again: after DeviceError{lost}. What was on its way is gone. Throws
  /// DeviceError{lost, not_found, refused}; then it may be tried again.
  virtual void reopen() = 0;
};

/// A message that an instrument sends, and when.
struct TimedMessage {
  Time at{};
  ByteString bytes;
};

/// The instrument's end of the same wire. It has no thread and no clock: the time is an argument,
/// which never goes back.
class MessagePeer {
 public:
  virtual ~MessagePeer() = default;
  virtual void receive(std::span<const std::uint8_t> message, Time now) = 0;
  /// What it has sent up to `now` and was not yet taken, in order.
  virtual std::vector<TimedMessage> say(Time now) = 0;
  /// When it will send something next if it receives nothing before; kForever when never. In the
  /// past: messages wait to be taken.
  virtual Time next() const = 0;
  /// Told to forget what it was about to say.
  virtual void clear(Time /*now*/) {}
  /// Switched off and on: what it does not keep is as after power-up.
  virtual void power_cycle(Time /*now*/) {}
};

/// A link in memory; a message takes `latency` either way, for which a writer waits. Of `faults`,
/// keep and garble count the bytes of each message. `peer` and `faults` (may be null) outlive the
/// link, and the clock does. Throws std::invalid_argument for a negative latency.
std::unique_ptr<MessageLink> memory_message_link(MessagePeer& peer, Clock& clock, Time latency = {},
                                                 const LinkFaults* faults = nullptr);

}  // namespace vitreo
