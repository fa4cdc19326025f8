// Configuration ROM of an IIDC camera (IEEE 1212; IIDC 1.31, chapter 2).
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "tests/devices/firewire/bus.h"

#include <cstdint>
#include <vector>

namespace vitreo {

/// Its quadlets, in the host's byte order, from the bus info block on. Check sums are zero: neither
/// Linux' interface nor libdc1394 looks at them.
std::vector<std::uint32_t> configuration_rom(const FireWireCamera& camera);

}  // namespace vitreo
