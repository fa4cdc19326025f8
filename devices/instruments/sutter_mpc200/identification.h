// Identification of an MPC-200: its own numbers on USB, or its active drive and firmware.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/identification.h"

namespace vitreo::sutter_mpc200 {

Identification identification();

}  // namespace vitreo::sutter_mpc200
