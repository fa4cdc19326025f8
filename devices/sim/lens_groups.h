// Lens groups: which surfaces of an eye before a condensing lens are its own lens, its cornea and
// the condensing lens.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/system/system.h"

#include <optional>

namespace vitreo::sim {

/// Numbers of surfaces, from 1. The retina is surface 1, the eye's own lens all from 2 to the front
/// one, whatever lies in it (a gradient lens has a plane at its equator).
struct LensGroups {
  int inner_lens = 0;        // its rear surface
  int inner_lens_front = 0;  // the last before the aqueous
  int cornea = 0;            // its front, behind which is the air before the condensing lens
  int condensing_lens = 0;   // its inner surface; its outer one is the system's last
};

/// Of a retina, a lens of two surfaces or more, a cornea of two and, across a gap of index 1, a
/// condensing lens of two with air behind it. Nothing of any other system.
std::optional<LensGroups> lens_groups(const optics::System& eye);

}  // namespace vitreo::sim
