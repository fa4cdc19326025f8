// Identification of a data logger, for `vitreo devices --ask`.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/identification.h"

namespace vitreo::scpi_logger {

Identification identification();

}  // namespace vitreo::scpi_logger
