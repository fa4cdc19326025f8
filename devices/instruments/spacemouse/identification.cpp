// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/spacemouse/identification.h"

namespace vitreo::spacemouse {

// Under Logitech's vendor number, and under 3Dconnexion's own (spacenavd's device table).
Identification identification() {
  const std::vector<ProposedRole> roles{{"joystick"}};
  return {.usb = {{0x046D,
                   {0xC603, 0xC605, 0xC606, 0xC621, 0xC623, 0xC625, 0xC626, 0xC627, 0xC628, 0xC629,
                    0xC62B},
                   roles},
                  {0x256F,
                   {0xC62E, 0xC62F, 0xC631, 0xC632, 0xC633, 0xC635, 0xC636, 0xC638, 0xC63A, 0xC652},
                   roles}}};
}

}  // namespace vitreo::spacemouse
