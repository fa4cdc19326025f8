// Classes of the module `optics`, and its functions.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/lua/interpreter/binding.h"

#include <vector>

namespace vitreo::lua {

const Class& optical_system_class();
const Class& wide_angle_map_class();
const Class& localizer_class();
const Class& viewing_chain_class();
const Class& axis_law_class();
/// The module `optics`.
const std::vector<Binding>& optics_functions();

}  // namespace vitreo::lua
