// Arithmetic of a Zaber chain's serial line: the time of a command to move.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/instruments/zaber/wire.h"
#include "devices/links/link_time.h"

namespace vitreo::zaber {

/// A motion's command to one axis and its reply, of the usual length. `baud_rate` 0: TCP.
inline LinkTime move_time(int baud_rate) {
  constexpr int kId = 10;  // ids have one or two digits; replies two
  Message reply;
  reply.device = reply.axis = 1;
  reply.id = kId;
  reply.data = "0";
  return serial_time(encode(Command{1, 1, kId, "move abs 100000"}).size(),
                     encode(reply, true).size(), baud_rate);
}

}  // namespace vitreo::zaber
