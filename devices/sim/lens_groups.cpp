// SPDX-License-Identifier: Apache-2.0
#include "devices/sim/lens_groups.h"

#include <cstddef>

namespace vitreo::sim {

// A condensing lens, and a cornea, are two surfaces each, counted from the system's last one.
std::optional<LensGroups> lens_groups(const optics::System& eye) {
  constexpr int kLeast = 7;  // retina, lens 2, cornea 2, condensing lens 2
  const int surfaces = eye.size();
  if (surfaces < kLeast) return std::nullopt;
  const LensGroups groups{2, surfaces - 4, surfaces - 2, surfaces - 1};
  const auto behind = [&](int surface) {
    return eye.surfaces[static_cast<std::size_t>(surface) - 1].index;
  };
  if (behind(groups.cornea) != 1 || behind(surfaces) != 1) return std::nullopt;
  return groups;
}

}  // namespace vitreo::sim
