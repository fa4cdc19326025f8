// Shared parts of the readers of USB instruments.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/usb_frames.h"
#include "host/rig/registry.h"

namespace vitreo {

/// `transfer_interval`, s: how far apart the transfers of an endpoint are, the bInterval of the
/// device's descriptor; a frame at best, or, of an emulated instrument, 0 for none at all.
inline double read_transfer_interval(const InstrumentReader& instrument) {
  const double frame = to_seconds(kUsbFrame);
  return instrument.reader.number("transfer_interval", frame,
                                  {instrument.emulated() ? 0 : frame, 0.255, "s"});
}

}  // namespace vitreo
