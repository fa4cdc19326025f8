// Classes of the module `vision`, and its functions.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/lua/interpreter/binding.h"

#include <vector>

namespace vitreo::lua {

const Class& image_class();
const Class& video_class();
const Class& color_model_class();
const Class& tracker_class();
const Class& background_tracker_class();
const Class& retina_map_class();
const Class& autofocus_class();
/// The module `vision`.
const std::vector<Binding>& vision_functions();

}  // namespace vitreo::lua
