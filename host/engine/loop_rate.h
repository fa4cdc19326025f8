// Rate of a servo loop that the links of a rig can hold, beside the one that its camera asks for.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/rig/link_load.h"

#include <set>
#include <string>
#include <vector>

namespace vitreo {

struct LoopRate {
  std::vector<LinkLoad> links;  ///< that take any time
  std::string source{};         ///< the role by whose measurements a loop turns; "" where none does
  double asked = 0;             ///< Hz, of its measurements
  double held = 0;              ///< Hz, of the slowest link in the loop; 0: none takes any time
  std::string limit{};          ///< the role of that link
};

/// By the roles in `sources`; where there are none by the top camera, else the pose sensor. A loop
/// takes a measurement and sets the coils once in each turn; while the one is on its link the
/// other's may be busy too, so the slowest alone decides.
LoopRate loop_rate(const LinkLoads& rig, const std::set<std::string>& sources = {});

/// What cannot be held of the loops that turn by `sources`, a sentence a link, which it names.
std::vector<std::string> beyond_links(const LinkLoads& rig, const std::set<std::string>& sources);

}  // namespace vitreo
