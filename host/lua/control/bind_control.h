// What the bindings of the control module share. A trajectory's object is a control::Trajectory, a
// field_model's a control::FieldModel.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/field_calibration.h"
#include "control/trajectory.h"
#include "host/lua/interpreter/binding.h"

#include <vector>

namespace vitreo::lua {

/// The list of positions at `index`; `name` is in errors.
std::vector<Eigen::Vector3d> points_at(lua_State* L, int index, const char* name);
/// The options speed and acceleration, and what they say.
std::vector<Argument> motion_options();
control::MotionLimits motion_limits(const Call& call);

/// A list with a table {sign, gain, angle} a coil; angle in rad.
void push_comparison(lua_State* L, const std::vector<control::CoilComparison>& coils);

const Class& trajectory_class();
const Class& field_model_class();
/// "control.line" and such: what the module `control` holds.
const std::vector<Binding>& control_functions();

/// The rows of the module `control`, by file.
std::vector<Binding> trajectory_functions();
std::vector<Binding> field_functions();
std::vector<Binding> field_fit_functions();
/// A method of field_model.
Binding field_text_row();

}  // namespace vitreo::lua
