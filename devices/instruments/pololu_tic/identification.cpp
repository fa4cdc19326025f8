// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/pololu_tic/identification.h"

#include "devices/instruments/pololu_tic/wire.h"

namespace vitreo::pololu_tic {

Identification identification() {
  return {.usb = {{kVendor,
                   {kProducts.begin(), kProducts.end()},
                   {{"lens_mover", {}, "step_length and travel are the spindle's"}}}}};
}

}  // namespace vitreo::pololu_tic
