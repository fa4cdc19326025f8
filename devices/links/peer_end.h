// Far end of a real wire, for emulators: a pseudo-terminal or a TCP port that any program can open.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/byte_link.h"

#include <memory>
#include <string>

namespace vitreo {

/// Its owner calls pump() again and again; or transfer() in one thread and exchange() in another,
/// where an emulator that is busy must not hold up what is on the wire. None of them blocks.
/// Destruction hangs up: the other side sees a pulled cable.
class PeerEnd {
 public:
  virtual ~PeerEnd() = default;
  virtual const std::string& address() const = 0;  ///< as a rig file would write it
  /// Puts on the line what the other side has sent since the last call, and sends what has arrived
  /// at the line's other end. Touches no emulator.
  virtual void transfer(Time now) = 0;
  /// Gives `peer` what has arrived, and puts on the line what it has to send.
  virtual void exchange(BytePeer& peer, Time now) = 0;
  /// When a byte is next to be sent to the other side; kForever when none is on its way there.
  virtual Time next() const = 0;
  void pump(BytePeer& peer, Time now) {
    transfer(now);
    exchange(peer, now);
    transfer(now);
  }
};

/// Both throw DeviceError{refused} when the system does not give one. `per_byte`: character_time()
/// of the line that the pseudo-terminal stands for, which has no time of its own; bytes then follow
/// one another at that distance, both ways at once; zero: they take no time. Bytes through TCP take
/// none: on a laboratory's network they take less than a millisecond. The TCP port is on 127.0.0.1
/// and takes one connection at a time; 0: any free one.
std::unique_ptr<PeerEnd> open_pty_end(Time per_byte = {});
std::unique_ptr<PeerEnd> open_tcp_end(int port = 0);

}  // namespace vitreo
