// Sweep report: one self-contained page with what was varied, maps and lines of the results, what
// failed and what took longest.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/trials/point_folder.h"
#include "host/trials/sweep_table.h"

#include <string>

namespace vitreo {

/// `shown`: the result with which it begins; "": the first one. Throws ConfigError where there is
/// no such result.
std::string sweep_report_html(const SweepTable& table, const nlohmann::json& head,
                              const std::string& shown);

/// report.html in the folder.
void write_sweep_report(const SweepTable& table, const PointFolder& folder,
                        const std::string& shown);

}  // namespace vitreo
