// Emulator of a BOP supply: its end of the wire, for the simulated laboratory and the tests.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/byte_link.h"

#include <functional>
#include <memory>
#include <string>

namespace vitreo::kepco_bop {

struct EmulatorSettings {
  double max_current = 12;  ///< A
  double max_voltage = 36;  ///< V
  std::string identity = "KEPCO,BOP 36-12MG,A123456,1.74";
  double gain = 1;            ///< of what flows to what was asked for
  bool network = false;       ///< a LAN option: set commands are not answered by CR LF
  bool flow_control = false;  ///< it wraps its answers in XOFF and XON
};

class Emulator : public BytePeer {
 public:
  virtual double current() const = 0;  ///< A, that flows
  virtual bool output() const = 0;     ///< whether its output is on
};

/// `on_current` is called with the time whenever what flows has changed.
std::unique_ptr<Emulator> make_emulator(const EmulatorSettings& settings = {},
                                        std::function<void(Time, double)> on_current = {});

}  // namespace vitreo::kepco_bop
