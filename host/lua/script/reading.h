// Reading of protocol and rig files, which does not run them.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/session/script_engine.h"

#include <string>
#include <vector>

namespace vitreo::lua {

struct Library;

/// `library`: what the file may name while it is read.
ProtocolDescription describe_protocol(const Library& library, const std::string& file,
                                      const std::vector<std::string>& folders);
/// With what it builds on (`base`), which is looked for beside it and in rigs/ of the folders.
/// Throws ScriptError.
RigDescription read_rig_file(const Library& library, const std::string& file,
                             const std::vector<std::string>& folders);
RigDescription read_recorded_rig(const Library& library, const RigSource& rig,
                                 const std::vector<RigSource>& bases);

}  // namespace vitreo::lua
