// Identification of a Kepco BOP on a port, by *IDN?.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/identification.h"

namespace vitreo::kepco_bop {

Identification identification();

}  // namespace vitreo::kepco_bop
