// Heights of the surfaces of a layout drawing.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/analysis/layout_rays.h"

#include <span>
#include <vector>

namespace vitreo::optics::detail {

/// Per surface, m: its semi-diameter; else what the rays need and some more, the same on both sides
/// of a solid, no higher than the surfaces reach and than where they would cross.
std::vector<double> layout_heights(const System& system, std::span<const LayoutRay> rays);

}  // namespace vitreo::optics::detail
