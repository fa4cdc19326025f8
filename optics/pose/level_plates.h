// How a robot of two crossed plates lies: with one of them level.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <cmath>

namespace vitreo::optics {

/// Unit direction across the axis (unit, z up) in the plate that is level; of a robot along the
/// line of sight the one along y.
inline Eigen::Vector3d level_side(const Eigen::Vector3d& axis) {
  const Eigen::Vector3d other =
      std::abs(axis.z()) < 0.99 ? Eigen::Vector3d::UnitZ() : Eigen::Vector3d::UnitX();
  return other.cross(axis).normalized();
}

}  // namespace vitreo::optics
