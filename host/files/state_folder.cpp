// SPDX-License-Identifier: Apache-2.0
#include "host/files/state_folder.h"

#include <cstdlib>

namespace vitreo {

// XDG base directory specification: a relative path is to be ignored, and an empty variable counts
// as unset.
std::filesystem::path state_folder() {
  if (const char* const state = std::getenv("XDG_STATE_HOME"); state != nullptr && *state == '/')
    return std::filesystem::path(state) / "vitreo";
  if (const char* const home = std::getenv("HOME"); home != nullptr && *home == '/')
    return std::filesystem::path(home) / ".local" / "state" / "vitreo";
  return {};
}

}  // namespace vitreo
