// Classes of the handles of a run, and the rows of its calls.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/lua/interpreter/binding.h"

#include <vector>

namespace vitreo::lua {

const Class& run_class();
const Class& reminder_class();
const Class& alarm_class();
/// The module `files`.
const std::vector<Binding>& files_functions();

/// The rows of run_class, by file.
std::vector<Binding> run_flow_rows();
std::vector<Binding> run_control_rows();
std::vector<Binding> run_question_rows();
std::vector<Binding> run_alarm_rows();
std::vector<Binding> run_operator_rows();
std::vector<Binding> run_record_rows();
std::vector<Binding> run_result_rows();
/// The row run:judge.
Binding judge_row();
/// The row run:install_calibration.
Binding install_calibration_row();
/// The row of the global function format_quantity.
Binding format_quantity_row();

}  // namespace vitreo::lua
