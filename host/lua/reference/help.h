// Global functions of scripts and of the prompt.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/lua/interpreter/binding.h"

#include <vector>

namespace vitreo::lua {

/// help() and format_quantity(): rows without an object.
const std::vector<Binding>& global_functions();

}  // namespace vitreo::lua
