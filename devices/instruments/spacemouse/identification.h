// Identification of 3Dconnexion's devices, by their numbers on USB.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/identification.h"

namespace vitreo::spacemouse {

Identification identification();

}  // namespace vitreo::spacemouse
