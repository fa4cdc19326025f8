// Shared parts of the bindings of the control module. A trajectory's object is a
// control::Trajectory, a field_model's a control::FieldModel, a control_law's a LawGains.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/field_calibration.h"
#include "control/field_model.h"
#include "control/pd.h"
#include "control/trajectory.h"
#include "control/velocity_control.h"
#include "host/lua/interpreter/tables.h"
#include "host/servo/rotating_law.h"

#include <optional>
#include <variant>
#include <vector>

namespace vitreo::lua {

/// The list of positions at `index`; `name` is in errors.
std::vector<Eigen::Vector3d> points_at(lua_State* L, int index, const char* name);
/// The options speed and acceleration, and what they say.
std::vector<Argument> motion_options();
control::MotionLimits motion_limits(const Call& call);

/// The field "coils" of a result: each coil as it compares with a model, and its fields.
std::vector<ResultField> comparison_fields();
void add_comparison(ResultTable& report, const std::vector<control::CoilComparison>& coils);

/// Gains of the law "estimator"; what is not given is tuned.
struct EstimatorGains {
  std::optional<double> proportional{};  // 1/s
  std::optional<double> max_speed{};     // m/s
};
using LawGains =
    std::variant<control::PdGains, EstimatorGains, control::VelocityGains, RotatingSettings>;

const Class& trajectory_class();
const Class& control_law_class();
const Class& field_model_class();
/// "control.line" and such: what the module `control` holds.
const std::vector<Binding>& control_functions();

/// The rows of the module `control`, by file.
std::vector<Binding> trajectory_functions();
std::vector<Binding> law_functions();
std::vector<Binding> field_functions();
std::vector<Binding> field_fit_functions();
std::vector<Binding> identification_functions();
/// A method of field_model.
Binding field_text_row();

}  // namespace vitreo::lua
