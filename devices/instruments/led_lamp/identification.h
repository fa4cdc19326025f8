// Identification of the USB-3103 behind which a lamp may be.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/identification.h"

namespace vitreo::led_lamp {

Identification identification();

}  // namespace vitreo::led_lamp
