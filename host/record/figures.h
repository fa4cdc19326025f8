// Figures of a run: its drawings and plots with the names of their files.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/record/run_data.h"

#include <functional>
#include <string>
#include <vector>

namespace vitreo {

struct Figure {
  std::string name;                  // of its file, without ending: "01_Path_in_depth"
  std::function<std::string()> svg;  // the document; borrows the run's data
};

/// In the report's order, drawings before plots, numbered from 1.
std::vector<Figure> figures_of(const RunData& data);

}  // namespace vitreo
