// run:picture: an image, an image under an overlay, or a drawing, for the report.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/lua/interpreter/binding.h"

namespace vitreo::lua {

Binding picture_row();

}  // namespace vitreo::lua
