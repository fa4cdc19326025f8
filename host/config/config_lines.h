// Lines of the keys of a table that a Lua text returns, for errors that lead to the right line.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string_view>

namespace vitreo {

/// The line (from 1) of the Lua text on which "top_camera.focus" gets its value: in the table that
/// the text returns, in a variable's table that stands there by its name, or in an assignment; the
/// items of a list are "list.1", "list.2". Of a key that stands nowhere, the line of the table it
/// belongs to. Where that table is computed (a call, a loop), the line on which a key of that name
/// is set elsewhere in the text, else the line of the computation. 0 when nothing of it is there.
int find_line(std::string_view text, std::string_view dotted_key);

}  // namespace vitreo
