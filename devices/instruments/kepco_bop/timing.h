// Arithmetic of a BOP's serial line: the time of a set point, and the ramp that leaves.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/instruments/kepco_bop/driver.h"
#include "devices/links/link_time.h"

#include <string>

namespace vitreo::kepco_bop {

/// A set point of all channels, with its read-back: the longest line that the driver sends for it
/// and the longest answer, in which XOFF and XON stand as the supplies put them there by default.
/// The channels' lines are sent side by side, so eight take as long as one. `baud_rate` 0: TCP.
LinkTime update_time(const Settings& settings, int baud_rate);

/// A/s: the ramp that large steps are made with, at most max_slope. Slower than that where a set
/// point takes longer than step_time.
double ramp_slope(const Settings& settings, const LinkTime& update);
/// What to say of a ramp that is slower than asked for; empty where it is not.
std::string slow_ramp(const Settings& settings, const LinkTime& update);

}  // namespace vitreo::kepco_bop
