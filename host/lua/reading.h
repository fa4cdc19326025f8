// Files that are read, not run.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/script_engine.h"

#include <string>
#include <vector>

namespace vitreo::lua {

ProtocolDescription describe_protocol(const std::string& file, const std::vector<std::string>& folders);
RigDescription read_rig_file(const std::string& file, const std::vector<std::string>& folders);

}  // namespace vitreo::lua
