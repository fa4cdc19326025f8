// Rescue of a USB-3103: outputs at 0 V after the death of the host that drove it.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/instruments/rescue.h"
#include "devices/links/hid_link.h"
#include "devices/time/clock.h"

#include <optional>

namespace vitreo::usb3103 {

/// Disables the amplifiers and sets every output to 0 V, whatever it holds: all reports are sent
/// without waiting for an answer, for each that gets through counts. Then asks for the status.
/// Throws DeviceError when that, or a report, failed.
void rescue(HidLink& link, std::optional<int> enable_line, Clock& clock);

/// What the guardian needs to know, under the driver's name in the rig file.
Rescue rescue_row(std::string_view driver);

}  // namespace vitreo::usb3103
