// The guardian's duty: to bring to zero what a host that is gone has left energised. Knows the devices and nothing
// else.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/clock.h"
#include "host/guardian/wire.h"

namespace vitreo::guardian {

/// Throws std::invalid_argument for a driver or an address that it does not know: before anything is energised.
void check(const Output& output);

/// Opens, resynchronises, zeroes and reads back as far as the instrument can. Throws DeviceError: to be tried again.
void bring_to_zero(const Output& output, Clock& clock);

}  // namespace vitreo::guardian
