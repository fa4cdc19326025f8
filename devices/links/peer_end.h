// Far end of a real wire, for emulators: a pseudo-terminal or a TCP port that any program can open.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/byte_link.h"

#include <memory>
#include <string>

namespace vitreo {

/// Its owner calls pump() again and again. Destruction hangs up: the other side sees a pulled
/// cable.
class PeerEnd {
 public:
  virtual ~PeerEnd() = default;
  virtual const std::string& address() const = 0;  ///< as a rig file would write it
  /// Gives `peer` what has arrived and sends what it has to send; never blocks.
  virtual void pump(BytePeer& peer, Time now) = 0;
};

/// Both throw DeviceError{refused} when the system does not give one. The TCP port is on 127.0.0.1
/// and takes one connection at a time; 0: any free one.
std::unique_ptr<PeerEnd> open_pty_end();
std::unique_ptr<PeerEnd> open_tcp_end(int port = 0);

}  // namespace vitreo
