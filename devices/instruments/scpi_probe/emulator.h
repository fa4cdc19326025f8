// Emulator of a teslameter: its end of the wire, for the simulated laboratory and the tests.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/byte_link.h"

#include <functional>
#include <memory>
#include <string>
#include <vector>

namespace vitreo::scpi_probe {

struct EmulatorSettings {
  std::string identity = "VITREO,PROBE-3,P001,1.0";
  std::string question = "MEAS:FIEL?";
  double range = 0.1;  ///< in its own unit: beyond it, it answers the number of an overload
  Time duration = std::chrono::milliseconds(20);  ///< of a measurement
};

/// `field` is asked when a measurement begins, and gives its numbers in the instrument's own unit.
std::unique_ptr<BytePeer> make_emulator(const EmulatorSettings& settings,
                                        std::function<std::vector<double>(Time)> field);

}  // namespace vitreo::scpi_probe
