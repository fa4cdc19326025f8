// Driver of 3Dconnexion's SpaceMouse and SpaceNavigator: a handle with six axes that sends reports
// only while it is deflected.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/hid_link.h"
#include "devices/roles/operator_input.h"
#include "devices/time/clock.h"

#include <memory>
#include <string>

namespace vitreo::spacemouse {

struct Settings {
  std::string name = "joystick";  ///< in errors
  double dead_zone = 0.03;        ///< of full deflection: what counts as none
  /// s without a report after which a deflection counts as none: the report of its end may be lost.
  double watchdog = 0.1;
  void check() const;  ///< throws std::invalid_argument naming the setting
};

/// Opening asks nothing of the device, which cannot be asked. Throws DeviceError{lost}.
std::unique_ptr<OperatorInput> open(std::unique_ptr<HidLink> link, const Settings& settings,
                                    Clock& clock);

}  // namespace vitreo::spacemouse
