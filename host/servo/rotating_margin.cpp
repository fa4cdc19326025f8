// SPDX-License-Identifier: Apache-2.0
#include "host/servo/rotating_margin.h"

namespace vitreo {

// The robot's own velocity is d + (1 + g) (u + s): u what it swims, s its sinking, both answered
// with the filter's gain. As under the other laws that is projected (control::keep_out), and solved
// for u. The rate is theirs, too: the lag of the axis is in the loop's dead time.
std::optional<Eigen::Vector3d> margin_kept(const RobotClearance& clearance,
                                           const SwimmingBody& body, const Eigen::Vector3d& swum) {
  const control::PositionEstimate& ahead = body.ahead;
  const auto near = clearance.at(ahead.position, ahead.covariance.topLeftCorner<3, 3>());
  if (!near) return std::nullopt;
  control::KeepOut settings;
  settings.margin = clearance.margin();
  settings.rate = 0.25 / body.dead_time;
  const double response = 1 + ahead.gain;
  const control::KeptOut kept =
      control::keep_out(settings, *near, ahead.disturbance + response * (swum + body.sinking));
  if (!kept.limited) return std::nullopt;
  return (kept.velocity - ahead.disturbance) / response - body.sinking;
}

}  // namespace vitreo
