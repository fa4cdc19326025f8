// Identification of foot pedals, by their numbers on USB.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/identification.h"

namespace vitreo::foot_pedal {

Identification identification();

}  // namespace vitreo::foot_pedal
