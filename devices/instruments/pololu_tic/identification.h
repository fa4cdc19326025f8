// Identification of Pololu's Tics, by their numbers on USB.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/identification.h"

namespace vitreo::pololu_tic {

Identification identification();

}  // namespace vitreo::pololu_tic
