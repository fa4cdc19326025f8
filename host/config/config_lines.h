// Where in a rig file a key stands, for errors that a person can click on.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>

namespace vitreo {

/// The line (from 1) of the Lua text on which "top_camera.focus" gets its value; where the value
/// comes from somewhere else (a variable, a loop), the line of the word or of its parent; 0 when
/// nothing of it is there.
int find_line(std::string_view text, std::string_view dotted_key);

}  // namespace vitreo
