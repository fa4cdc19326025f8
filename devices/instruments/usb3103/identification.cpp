// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/usb3103/identification.h"

namespace vitreo::usb3103 {

// Measurement Computing's.
Identification identification() {
  return {
      .usb = {{0x09DB,
               {0x009C},
               {{"coils", {}, "amperes_per_volt is the amplifiers'; enable_line enables them"}}}}};
}

}  // namespace vitreo::usb3103
