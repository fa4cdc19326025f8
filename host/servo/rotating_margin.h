// Keep-out margin of a robot in a rotating field: the velocity through the fluid, nearest to the
// one asked for, with which its surface does not come nearer to a wall than the margin.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/estimator.h"
#include "host/servo/robot_clearance.h"

#include <Eigen/Core>

#include <optional>

namespace vitreo {

/// What moves the robot beside its swimming.
struct SwimmingBody {
  control::PositionEstimate ahead;   // when the command acts
  Eigen::Vector3d sinking{0, 0, 0};  // m/s, world
  double dead_time = 0.1;            // s, of the loop
};

/// `swum`: m/s, through the fluid. Nothing where it keeps the margin.
std::optional<Eigen::Vector3d> margin_kept(const RobotClearance& clearance,
                                           const SwimmingBody& body, const Eigen::Vector3d& swum);

}  // namespace vitreo
