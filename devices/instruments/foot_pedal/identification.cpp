// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/foot_pedal/identification.h"

namespace vitreo::foot_pedal {

// PI Engineering's; the layouts' names are those of the rig file.
Identification identification() {
  const std::string note = "dead_man = { 2 }: currents flow only while pedal 2 is held";
  return {.usb = {{0x05F3, {0x0268}, {{"pedal", {{"layout", "\"xkeys_xk3\""}}, note}}},
                  {0x05F3,
                   {0x0438, 0x0439, 0x043A, 0x04E8},
                   {{"pedal", {{"layout", "\"xkeys_xk3_0438\""}}, note}}},
                  {0x05F3, {0x00FF}, {{"pedal", {{"layout", "\"infinity\""}}, note}}}}};
}

}  // namespace vitreo::foot_pedal
