// Arithmetic of an MP-285's serial line: the time of a command to move.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/instruments/sutter_mp285/wire.h"
#include "devices/links/link_time.h"

namespace vitreo::sutter_mp285 {

/// A motion's command, and the CR at its end, without the motion. `baud_rate` 0: TCP.
inline LinkTime move_time(int baud_rate) {
  return serial_time(encode(Move{}).size(), 1, baud_rate);
}

}  // namespace vitreo::sutter_mp285
