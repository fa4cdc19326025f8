// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/led_lamp/identification.h"

#include "devices/instruments/usb3103/identification.h"

namespace vitreo::led_lamp {

// The same device as the coils': which of two it is, only their serial numbers tell.
Identification identification() {
  Identification all = usb3103::identification();
  for (UsbKind& kind : all.usb)
    kind.roles = {{"lamp", {{"output", "0"}}, "full_current is what the LEDs bear"}};
  return all;
}

}  // namespace vitreo::led_lamp
