// Values as they are written in a Lua file.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>

namespace vitreo {

/// In quotes; what is not printable ASCII as \ddd.
std::string lua_quoted(std::string_view text);

}  // namespace vitreo
