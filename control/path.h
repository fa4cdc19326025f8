// Where to be, when: paths as functions of time.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/pd.h"

#include <Eigen/Core>

#include <vector>

namespace vitreo::control {

/// Straight lines through waypoints at one speed, resting at neither end nor corner.
class Path {
 public:
  /// Throws std::invalid_argument for fewer than one point, a speed not above zero, or numbers that are not finite.
  Path(std::vector<Eigen::Vector3d> waypoints, double speed);  // m, world; m/s
  double duration() const;                                     // s
  double length() const;                                       // m
  /// Clamped: before 0 the start, from the end on the last point, both at rest. At a corner the way out counts.
  Reference at(double time) const;
  const std::vector<Eigen::Vector3d>& waypoints() const { return waypoints_; }

 private:
  std::vector<Eigen::Vector3d> waypoints_;
  std::vector<double> arrival_;  // s, at each waypoint
};

}  // namespace vitreo::control
