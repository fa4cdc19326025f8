// run:image_plot: an image with an overlay, for the report.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/lua/interpreter/binding.h"

namespace vitreo::lua {

Binding image_plot_row();

}  // namespace vitreo::lua
