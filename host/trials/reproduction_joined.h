// Joined rows of the reproduction: numbers about several runs together, such as a median over three
// experiments.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/trials/reproduction.h"

namespace vitreo {

/// One row made from others: the median of all the values that they are medians of (`values` of
/// scripts/analysis/expectations.lua), or of themselves where they name none.
struct JoinedRow {
  std::string id;
  std::string what;
  std::string where;
  std::string unit;
  std::string reason;
  std::vector<std::string> of;    // ids of the rows
  std::optional<double> at_most;  // SI; without it there is no verdict
};

/// Of the same plan as read_plan: key = { joins = { ids }, id =, what =, where =, unit =, at_most
/// =, reason = }. Throws ConfigError.
std::vector<JoinedRow> read_joined(const RigDescription& plan);

/// The joined rows as one more section. A row of which something is missing has no answer and says
/// what is missing, where the `whole` plan was run; of a part of it, or of its short form, such a
/// row is left out.
ReproducedRun join_rows(const std::vector<JoinedRow>& wanted,
                        const std::vector<ReproducedRun>& runs, bool whole);

}  // namespace vitreo
