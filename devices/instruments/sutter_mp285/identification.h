// Identification of an MP-285 on a port, by its status.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/identification.h"

namespace vitreo::sutter_mp285 {

Identification identification();

}  // namespace vitreo::sutter_mp285
