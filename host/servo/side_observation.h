// Side observation: the robot's position as the side camera saw it.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/time/clock.h"

#include <Eigen/Core>

#include <optional>

namespace vitreo {

/// x and z, world frame.
struct SideObservation {
  Time exposed{};  ///< of its frame; of one between frames the moment that was asked for
  Eigen::Vector2d position{0, 0};                        // m
  Eigen::Matrix2d covariance = Eigen::Matrix2d::Zero();  // m^2, of all that is uncertain
  Eigen::Matrix2d systematic = Eigen::Matrix2d::Zero();  // m^2, the part of it that stays
  /// The robot's long axis as it shows, unit, x and z; nothing where its outline is round.
  std::optional<Eigen::Vector2d> direction{};
  double direction_sigma = 0;  // rad
  /// Of a pair: how much later than the top camera's frame the side camera's nearest was exposed.
  Time skew{};
};

}  // namespace vitreo
