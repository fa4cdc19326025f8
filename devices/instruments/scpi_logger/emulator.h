// Emulator of a data logger: its end of the wire, for the simulated laboratory and the tests.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/byte_link.h"

#include <functional>
#include <memory>
#include <string>

namespace vitreo::scpi_logger {

struct EmulatorSettings {
  std::string identity = "HEWLETT-PACKARD,34970A,0,13-2-2";
  Time per_channel = std::chrono::milliseconds(4);  ///< of a sweep, beside the reading's own time
  double mains = 50;                                ///< Hz, of the power line cycles of a reading
};

/// `volts` at a channel's terminals, asked when that channel is read.
std::unique_ptr<BytePeer> make_emulator(const EmulatorSettings& settings,
                                        std::function<double(int channel, Time now)> volts);

}  // namespace vitreo::scpi_logger
