// Identification of an instrument with SCPI on a port, by *IDN?.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/identification.h"

namespace vitreo::scpi_probe {

Identification identification();

}  // namespace vitreo::scpi_probe
