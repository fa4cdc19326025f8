// Data sheet of a run, DATA.md: what each of its files, streams, columns and channels is, from its
// record.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/record/run_data.h"

#include <string>

namespace vitreo {

inline constexpr const char* kDataSheet = "DATA.md";

/// Markdown. Of a record of an older version it says so; what that did not record is left out.
std::string data_sheet(const RunData& data);

}  // namespace vitreo
