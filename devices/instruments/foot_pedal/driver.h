// Driver of USB foot pedals: each pedal is one bit of one byte of a HID report. Also a dead-man:
// released or unplugged means stop.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/instruments/foot_pedal/wire.h"
#include "devices/links/hid_link.h"
#include "devices/roles/operator_input.h"

#include <memory>
#include <string>

namespace vitreo::foot_pedal {

struct Settings {
  std::string name = "pedal";   ///< in errors
  Layout layout = xkeys_xk3();  ///< where its pedals are in its reports
  void check() const;           ///< throws std::invalid_argument naming the setting
};

/// A pedal sends reports only when something changes: until the first, all its pedals count as
/// released.
std::unique_ptr<OperatorInput> open(std::unique_ptr<HidLink> link, const Settings& settings);

}  // namespace vitreo::foot_pedal
