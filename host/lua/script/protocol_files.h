// Lookup of protocols by name.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/lua/interpreter/context.h"

#include <string>
#include <vector>

namespace vitreo::lua {

/// A file as given, else the name in one of the protocols' folders; "" where there is none.
std::string find_protocol(const Context& context, const std::string& name);
std::vector<std::string> protocol_names(const Context& context);

}  // namespace vitreo::lua
