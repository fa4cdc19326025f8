// SPDX-License-Identifier: Apache-2.0
#include "control/keep_out.h"

#include "control/preconditions.h"

#include <algorithm>

namespace vitreo::control {

void KeepOut::check() const {
  require(not_negative(margin), "keep_out margin: must be at least 0 m");
  require(positive(rate), "keep_out rate: must be above 0 1/s");
  require(positive(max_retreat), "keep_out max_retreat: must be above 0 m/s");
}

// The projection onto one half space, and onto the other: the walls face each other, so what one
// takes the other does not give back, but in a gap narrower than two margins, where the second, the
// nearer one, is right.
KeptOut keep_out(const KeepOut& settings, const Clearance& clearance,
                 const Eigen::Vector3d& wanted) {
  KeptOut kept{wanted, false};
  const WallClearance* const nearest = &clearance.nearest();
  const WallClearance* const other =
      nearest == &clearance.lens ? &clearance.retina : &clearance.lens;
  for (const WallClearance* const wall : {other, nearest}) {
    const double least =
        std::min(-settings.rate * (wall->bound() - settings.margin), settings.max_retreat);
    const double now = wall->normal.dot(kept.velocity);
    if (now >= least) continue;
    kept.velocity += (least - now) * wall->normal;
    kept.limited = true;
  }
  return kept;
}

}  // namespace vitreo::control
