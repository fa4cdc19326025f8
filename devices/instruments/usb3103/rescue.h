// A USB-3103 that a host which is gone has left energized.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/hid_link.h"
#include "devices/time/clock.h"

#include <optional>

namespace vitreo::usb3103 {

/// The amplifiers disabled, every output at 0 V, whatever it holds: told at once and unasked, for
/// each report that gets through counts. Then asks whether it lives. Throws DeviceError when that,
/// or a report, failed.
void rescue(HidLink& link, std::optional<int> enable_line, Clock& clock);

}  // namespace vitreo::usb3103
