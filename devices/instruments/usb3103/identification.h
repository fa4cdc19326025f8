// Identification of a USB-3103, by its numbers on USB.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/identification.h"

namespace vitreo::usb3103 {

Identification identification();

}  // namespace vitreo::usb3103
