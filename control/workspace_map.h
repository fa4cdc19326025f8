// Workspace map: the field and force that the coils can reach over a grid of positions.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/box_allocation.h"
#include "control/field_model.h"

#include <Eigen/Core>

#include <vector>

namespace vitreo::control {

/// One position of a map; a quantity that the coils cannot make there is 0.
struct MapPoint {
  Eigen::Vector3d position{0, 0, 0};  // m, world
  // T: the largest magnitude in the worst of 13 directions (and their opposites), no force asked
  double field = 0;
  double force = 0;      // T/m: force over moment in the worst of them, the field as asked
  double condition = 0;  // of currents to field and force over moment
};

struct MapRequest {
  Eigen::Vector3d low = Eigen::Vector3d::Constant(-10e-3);  // m, world
  Eigen::Vector3d high = Eigen::Vector3d::Constant(10e-3);  // m, world
  Eigen::Vector3i points{5, 5, 5};
  Eigen::Vector3d field{10e-3, 0, 0};  // T: held while force is made, and the moment's direction
  CurrentLimits limits = CurrentLimits::Constant(8, 12);
  void check() const;  // throws std::invalid_argument naming what is wrong
};

/// x fastest, then y, then z. Positions outside the model's region, and those where the coils have
/// lost a degree of freedom, are there with zeros (and an infinite condition).
std::vector<MapPoint> workspace_map(const FieldModel& model, const MapRequest& request);

}  // namespace vitreo::control
