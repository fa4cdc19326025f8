// Module `fit` of Lua: least-squares fits of curves to samples.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/lua/interpreter/binding.h"

#include <vector>

namespace vitreo::lua {

/// "fit.line" and such: what the module `fit` holds.
const std::vector<Binding>& fit_functions();

}  // namespace vitreo::lua
