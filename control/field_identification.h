// Field identification: what a robot's own motion through the workspace says of the coils' dipoles,
// as a maximum a posteriori estimate about the model that the loop believed.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/coil_field.h"
#include "control/robot.h"
#include "control/robot_identification.h"

#include <Eigen/Core>

#include <vector>

namespace vitreo::control {

/// What the amplifiers were given, and how easily the robot moved there.
struct TimedCurrents {
  double time = 0;                                         // s
  Currents currents;                                       // A, from `time` on
  Eigen::Matrix3d mobility = Eigen::Matrix3d::Identity();  // m/(N s), walls included
};

/// A stretch of motion under any law.
struct FieldMotion {
  std::vector<TimedVector> measured;  // m: positions, by the time of their exposure
  std::vector<TimedCurrents> commanded;
};

/// Standard deviations of what is believed beforehand, and of the motion itself.
struct FieldDoubt {
  FieldPerturbation coils;
  double background = 50e-6;  // T, of each component of a uniform field
  double response = 0.1;      // of the magnetic velocity, relative: moment over drag
  double sink = 0.1;          // of the sinking speed, relative: weight over drag
  double noise = 5e-6;        // m, of a measured coordinate
  double unexplained = 5e-6;  // m/s, of a coordinate over half a second
  void check() const;         // throws std::invalid_argument naming the number
};

struct FieldIdentification {
  CoilField field;
  Eigen::Vector3d background{0, 0, 0};  // T, uniform, beyond the believed one
  Identified response;                  // true over believed
  Identified sink;
  std::vector<Identified> gains;  // a coil: |moment per ampere| over the believed
  double before = 0;              // m/s, rms of a coordinate: velocity that the model did not have
  double after = 0;
  int rows = 0;  // displacements that were used
};

/// Least squares of displacements over half a second each: p' = (1 + r) M (m . grad) B - (1 + s) M
/// W, the moment m of the robot along its field B, as linear in the currents behind `delay` (s,
/// coils' lag included). Unknowns are each dipole's moment and position, a uniform background, r
/// and s, all with their priors, by Gauss-Newton with differences. What the motion does not show
/// stays as it was believed. Throws std::invalid_argument naming what is wrong, and
/// std::domain_error for fewer than a hundred displacements.
FieldIdentification identify_field(const CoilField& believed, const Robot& robot,
                                   const Medium& medium, const std::vector<FieldMotion>& motions,
                                   double delay, const FieldDoubt& doubt = {},
                                   const Eigen::Vector3d& background = Eigen::Vector3d::Zero());

}  // namespace vitreo::control
