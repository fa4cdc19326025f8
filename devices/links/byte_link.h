// Byte link: carries a stream of bytes, serial or TCP, to an instrument, an emulator or a
// recording; the driver never learns which.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/time/clock.h"

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

namespace vitreo {

using ByteString = std::vector<std::uint8_t>;

class ByteLink {
 public:
  virtual ~ByteLink() = default;
  virtual const std::string& address() const = 0;  ///< as in the rig file
  /// The address with the line's settings, for errors: "serial:/dev/ttyUSB0 at 9600 baud, 8N1".
  virtual std::string description() const { return address(); }
  /// All of it, or DeviceError{timeout} where the far end takes no more, {lost}. Stopped, but only
  /// once it is on its way, so that a stopped task can still stop its instrument.
  virtual void write(std::span<const std::uint8_t> bytes, Time timeout) = 0;
  /// What has arrived, at most `most` bytes; waits for the first one. Empty when none came within
  /// `timeout`. Throws DeviceError{lost} within 0.5 s of the far end's going, Stopped.
  virtual ByteString read(std::size_t most, Time timeout) = 0;
  /// Whether the far end has gone, as far as that shows without a byte: at once, and what has
  /// arrived stays.
  virtual bool hung_up() const { return false; }
  /// Closes it, and opens it again: after DeviceError{lost}. What was on its way is gone. Throws
  /// DeviceError{lost, not_found, refused}; then it may be tried again.
  virtual void reopen() = 0;
};

/// Bytes that an instrument sends, and when.
struct TimedBytes {
  Time at{};
  ByteString bytes;
};

/// The instrument's end of the same wire. It has no thread and no clock: the time is an argument,
/// which never goes back.
class BytePeer {
 public:
  virtual ~BytePeer() = default;
  virtual void receive(std::span<const std::uint8_t> bytes, Time now) = 0;
  /// What it has sent up to `now` and was not yet taken, in order.
  virtual std::vector<TimedBytes> say(Time now) = 0;
  /// When it will send something next if it receives nothing before; kForever when never. In the
  /// past: bytes wait to be taken.
  virtual Time next() const = 0;
  /// Switched off and on: what it does not keep is as after power-up.
  virtual void power_cycle(Time /*now*/) {}
};

/// Faults of a link in memory; set them at any time.
struct LinkFaults {
  bool unplugged = false;  ///< every call throws DeviceError{lost}
  bool deaf = false;       ///< what the host sends does not arrive
  bool silent = false;     ///< what the instrument sends does not arrive
  Time late{};             ///< how much later what the instrument sends arrives
  int keep = -1;    ///< only so many of the next bytes from the instrument arrive; negative: all
  int garble = -1;  ///< so many arrive before one arrives with `flip`; negative: none does
  std::uint8_t flip = 0x15;
};

struct MemoryLinkSettings {
  Time latency{};   ///< either way
  Time per_byte{};  ///< character_time() of a serial line; zero: bytes take no time
};

/// A link in memory: full duplex, each byte arrives when it would on such a line. As with a port of
/// the system's, a writer goes on at once; a task of the link's own delivers. Destruction waits
/// until what was written has arrived. `peer` and `faults` (may be null) outlive the link, and the
/// clock does.
std::unique_ptr<ByteLink> memory_byte_link(BytePeer& peer, Clock& clock,
                                           const MemoryLinkSettings& settings = {},
                                           const LinkFaults* faults = nullptr);

}  // namespace vitreo
