// Plots drawn as SVG text.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/plot/plot.h"

#include <string>

namespace vitreo {

/// Throws std::invalid_argument for series of unequal length or an unknown unit. An empty plot says
/// "no data". `width` and `height` in CSS px.
std::string to_svg(const Plot& plot, int width = 640, int height = 360);

}  // namespace vitreo
