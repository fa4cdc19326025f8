// SPDX-License-Identifier: Apache-2.0
#include "optics/system/placement.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>

namespace vitreo::optics {

Eigen::Matrix3d Placement::rotation() const {
  if (tilt.isZero(0)) return Eigen::Matrix3d::Identity();
  return (Eigen::AngleAxisd(tilt.x(), Eigen::Vector3d::UnitX()) *
          Eigen::AngleAxisd(tilt.y(), Eigen::Vector3d::UnitY()) *
          Eigen::AngleAxisd(tilt.z(), Eigen::Vector3d::UnitZ()))
      .toRotationMatrix();
}

/// The first row of Rx Ry Rz is (cos y cos z, -cos y sin z, sin y), the last column
/// (sin y, -sin x cos y, cos x cos y).
Eigen::Vector3d tilt_of(const Eigen::Matrix3d& rotation) {
  return {std::atan2(-rotation(1, 2), rotation(2, 2)),
          std::asin(std::clamp(rotation(0, 2), -1.0, 1.0)),
          std::atan2(-rotation(0, 1), rotation(0, 0))};
}

}  // namespace vitreo::optics
