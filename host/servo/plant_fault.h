// Plant fault: which failing amplifier or coil explains what a robot did beyond what was expected.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/coil_field.h"
#include "control/robot.h"

#include <Eigen/Core>

#include <string>
#include <vector>

namespace vitreo {

/// What the coils move a robot by, or m/s, their velocities: a column for all as told, one for no
/// current at all, and three a coil of what a failure of it adds to the first: with a lack c of its
/// current c (first) + c^2 (second), with its leads exchanged the third.
using PlantMotions = Eigen::Matrix<double, 3, Eigen::Dynamic>;
constexpr Eigen::Index kPlantAsTold = 0;
constexpr Eigen::Index kPlantNone = 1;
constexpr Eigen::Index kPlantCoils = 2;
constexpr Eigen::Index kPlantPerCoil = 3;

/// m/s, of a robot of this mobility (m/(N s)) in a medium, where the coils' field is `matrix`.
struct PlantForces {
  control::FieldMatrix matrix;
  control::FieldGradient background;
  double weight = 0;  // N, down
  Eigen::Matrix3d mobility;
};
PlantMotions plant_velocities(const control::Robot& robot, const PlantForces& forces,
                              const control::Currents& currents);

/// A place on the way through a window: what the coils made until then, and m, what the robot is
/// beyond where that and its drift would have it; both since the window's begin.
struct LeftOver {
  PlantMotions moved;
  Eigen::Vector3d left;
};

/// The amplifiers or the coil, failing since any place of the window or halfway between two, that
/// leaves least of what is left over, in words; beside it the coil that explains nearly as much.
/// `sigma`: m, of a place; what is left over is beyond it. Empty: nothing explains enough.
std::string plant_fault(const std::vector<LeftOver>& path, double sigma);

}  // namespace vitreo
