// Laboratory's column of the reproduction: the same protocols on the emulated laboratory, whose
// numbers are kept in a file, for they take real time.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/trials/reproduction.h"

namespace vitreo {

/// Those of the plan that have a rig of real drivers.
std::vector<PlannedRun> laboratory_runs(const std::vector<PlannedRun>& plan);

/// Puts the rows of completed runs into the file, by run and row, in the place of those that were
/// there. Throws std::runtime_error naming the file.
void keep_laboratory(const std::vector<ReproducedRun>& runs, const std::filesystem::path& file);

/// Fills ReproducedRow::laboratory from the file; a file that is not there has none.
void join_laboratory(std::vector<ReproducedRun>& runs, const std::filesystem::path& file);

}  // namespace vitreo
