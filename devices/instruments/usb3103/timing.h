// Arithmetic of a USB-3103's reports: the time of an update of its outputs.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/instruments/usb3103/wire.h"
#include "devices/links/link_time.h"

namespace vitreo::usb3103 {

/// An update of all outputs: a latched write a channel and the sync that makes them step together,
/// then the status and its answer. `interval`: s between two transfers of an endpoint (its
/// bInterval; 1 ms at best).
inline LinkTime update_time(double interval) {
  constexpr int kSync = 1;
  constexpr int kStatusAndAnswer = 2;
  return usb_time(kChannels + kSync + kStatusAndAnswer, interval);
}

}  // namespace vitreo::usb3103
