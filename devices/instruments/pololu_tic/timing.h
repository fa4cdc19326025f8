// Arithmetic of a Tic's control transfers: the time until a move sets off.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/link_time.h"

namespace vitreo::pololu_tic {

/// What the driver sends for a move of a motor that is ready: is it homed, energize, exit safe
/// start, is it ready, the target. `interval`: s, of one control transfer, about a frame.
inline LinkTime move_time(double interval) { return usb_time(5, interval); }

}  // namespace vitreo::pololu_tic
