// Parts of the report of a run: its head with the sentence and the number that matter, its plots, a
// table.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/record/run_data.h"
#include "host/text/units.h"

#include <nlohmann/json.hpp>

#include <string>

namespace vitreo {

/// What was done and what came out in one sentence, whether it is good, and the number that matters
/// beside what was expected of it. HTML.
std::string report_head(const RunData& data);
/// Who, when, with what: the facts of the start and end records, for the foot.
std::string report_facts(const RunData& data);
/// Each plot with its data as a table to be saved.
std::string report_plots(const RunData& data);
std::string report_table(const Table& table);

/// A verdict's word in its color: good, bad or neither.
std::string verdict_html(const std::string& verdict);

/// A plot's data, a row a point: the series' number, x, y, and the half-length of its bar, in the
/// axes' units.
std::string plot_csv(const Plot& plot);

/// With a minus in place of the hyphen.
std::string minus_sign(const std::string& number);
/// A number and its unit that do not part at the end of a line.
std::string printed(Shown shown);
/// "path error rms" of "path_error_rms".
std::string spaced(std::string name);
/// A value of a record as text.
std::string text_of(const nlohmann::json& value);

}  // namespace vitreo
