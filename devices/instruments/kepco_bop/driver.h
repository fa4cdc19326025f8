// Driver of Kepco BOP bipolar supplies in current mode, by SCPI over a serial port or TCP: several
// units as one amplifier.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/byte_link.h"
#include "devices/roles/coil_amplifier.h"
#include "devices/time/clock.h"

#include <memory>
#include <string>
#include <vector>

namespace vitreo::kepco_bop {

struct Settings {
  std::string name = "coils";  ///< in errors
  double current_limit = 12;   ///< A, per channel, either sign; also set as the supply's own limit
  double voltage_limit = 20;   ///< V: how far it may drive the coils' inductance
  /// A/s: larger steps are made in several set-points, for the coils are inductive.
  double max_slope = 200;
  double step_time = 0.02;     ///< s between those
  double reply_timeout = 0.5;  ///< s
  double settling_time = 0.3;  ///< s, within which the current follows its set-point
  /// A, between what was set lately and what is measured with every set-point.
  double read_back_tolerance = 0.2;
  void check() const;  ///< throws std::invalid_argument naming the setting
};

/// One link a channel. Opens each supply: identity, remote control, current mode, limits read back,
/// zero current, output on (off means zero current through a closed loop, since coils are
/// inductive). Throws DeviceError. make_safe() and destruction set zero at once, without a ramp:
/// the supply's own voltage limit bounds L dI/dt; destruction then switches the outputs off. A
/// supply has no watchdog: what holds its last current when the host dies is the guardian's to
/// switch off. After DeviceError{lost} make_safe() opens what was lost anew, at zero.
std::unique_ptr<CoilAmplifier> open(std::vector<std::unique_ptr<ByteLink>> links,
                                    const Settings& settings, Clock& clock);

}  // namespace vitreo::kepco_bop
