// Classes of the handles of a rig: its instruments, its simulation, its servo.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/lua/interpreter/binding.h"

namespace vitreo::lua {

const Class& rig_class();
const Class& camera_class();
const Class& coils_class();
const Class& lens_mover_class();
const Class& sample_class();
const Class& stage_class();
const Class& rotation_stage_class();
const Class& motion_class();
const Class& field_probe_class();
const Class& operator_input_class();
const Class& lamp_class();
const Class& simulation_class();
const Class& background_class();
const Class& servo_class();

}  // namespace vitreo::lua
