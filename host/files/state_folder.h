// Folder of the program's own state: log, history of the prompt.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>

namespace vitreo {

/// "vitreo" in XDG_STATE_HOME, else in ~/.local/state; empty where neither is an absolute path. It
/// is not made.
std::filesystem::path state_folder();

}  // namespace vitreo
