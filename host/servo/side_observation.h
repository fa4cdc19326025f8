// Side observation: the robot's position as the side camera saw it.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/time/clock.h"

#include <Eigen/Core>

namespace vitreo {

/// x and z, world frame.
struct SideObservation {
  Time exposed{};
  Eigen::Vector2d position{0, 0};                        // m
  Eigen::Matrix2d covariance = Eigen::Matrix2d::Zero();  // m^2
};

}  // namespace vitreo
