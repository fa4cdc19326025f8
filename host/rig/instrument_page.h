// Page of an instrument of one Lua file, made from its declaration: what a rig file says of it, and
// what scripts have of it.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/rig/instrument_file.h"

#include <string>

namespace vitreo {

/// Markdown. Throws ConfigError with the file's line for one that is wrong.
std::string instrument_page(const InstrumentFile& file);
/// One line for each of the program's own files.
std::string instrument_list(const RigDescription& rig);

}  // namespace vitreo
