// Comparison of runs: what was asked differently, results side by side, streams over each other, as
// one self-contained page.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/record/run_data.h"

#include <cstddef>
#include <string>
#include <vector>

namespace vitreo {

constexpr std::size_t kMostCompared = 8;  // lines that can be told apart

/// One line of a table: a name, and for each run the text, as it is shown.
struct ComparedLine {
  std::string name;
  std::vector<std::string> cells;  // one a run; "–" where a run has none
  std::string difference{};        // of two runs: the second less the first
};

struct RunComparison {
  std::vector<std::string> names;       // "A", "B", ...
  std::vector<ComparedLine> differing;  // parameters, seed, rig, protocol, versions that differ
  std::vector<std::string> same;        // names of those that do not
  std::vector<ComparedLine> results;    // each row in one unit
};

/// Throws std::invalid_argument for fewer than two or more than kMostCompared runs.
RunComparison compare_runs(const std::vector<RunData>& runs);

/// The page.
std::string comparison_html(const std::vector<RunData>& runs);

/// The tables, for a terminal.
std::string comparison_text(const std::vector<RunData>& runs);

}  // namespace vitreo
