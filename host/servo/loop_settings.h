// Settings of a servo loop's parts, as they follow from those of the servo and from its rig.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/attitude_law.h"
#include "host/rig/rig.h"
#include "host/servo/controller_settings.h"
#include "host/servo/rotating_controller.h"
#include "host/servo/servo_settings.h"

namespace vitreo {

/// What the controller needs of the settings, with the limits of the rig's coils. `period`: s,
/// between frames. Throws std::invalid_argument for a dead coil that there is not.
ControllerSettings controller_settings(const Rig& rig, const ServoSettings& given, double period);
/// The same of the law rotating.
RotatingControllerSettings rotating_settings(const Rig& rig, const ServoSettings& given,
                                             double period);
control::AttitudeGains attitude_gains(const Rig& rig);
/// What feeds the loop, for the record.
const char* source_of(Feedback feedback);
/// Throws std::invalid_argument: a field model of another number of coils would set currents of the
/// wrong ones.
void check_coils(const Rig& rig);

}  // namespace vitreo
