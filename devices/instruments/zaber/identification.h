// Identification of Zaber's devices on a port, by their version, model and serial numbers.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/identification.h"

namespace vitreo::zaber {

Identification identification();

}  // namespace vitreo::zaber
