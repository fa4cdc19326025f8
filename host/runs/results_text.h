// Stated results as text: lines of the command line, tiles of the report.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/record/run_data.h"
#include "host/text/units.h"

#include <string>
#include <vector>

namespace vitreo {

/// A result as it is shown. One of a dimension that others have, too, is in their unit; "depth" has
/// its "depth_sigma" behind a ±.
struct ShownResult {
  std::string name;
  Shown value;
};
std::vector<ShownResult> shown_results(const std::vector<StatedResult>& results);

/// A line for each, names and values in columns.
std::string results_text(const std::vector<StatedResult>& results);

}  // namespace vitreo
