// Library of all bindings: everything that scripts can call.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/lua/interpreter/library.h"

namespace vitreo::lua {

/// Made once; lives as long as the program.
const Library& library();

}  // namespace vitreo::lua
