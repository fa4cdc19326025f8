// Field identification: what a robot's own motion through the workspace says of the coils' dipoles,
// as a maximum a posteriori estimate about the model that the loop believed.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/coil_field.h"
#include "control/field_model.h"
#include "control/robot.h"
#include "control/robot_identification.h"

#include <Eigen/Core>

#include <optional>
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
  bool held_out = false;  // not fitted: the result is judged by it
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

/// One coil's field at the middle of the motion, against the believed: position and moment of its
/// dipole show together there, and neither alone.
struct IdentifiedCoil {
  Identified gain;            // of its strength
  double angle = 0;           // rad, between its direction and the believed one
  double angle_sigma = 0;     // rad, of either coordinate across
  double gain_believed = 0;   // sigmas beforehand: what is no smaller now was not told
  double angle_believed = 0;  // rad
};

/// Velocity of the robot that a model does not have: rms of a coordinate over half a second each.
struct Unexplained {
  double before = 0;  // m/s, of the believed model
  double after = 0;   // m/s, of the identified one
  int rows = 0;       // displacements
};

struct FieldIdentification {
  CoilField field;
  Eigen::Vector3d background{0, 0, 0};  // T, uniform, beyond the believed one
  Identified response{};                // true over believed
  Identified sink{};
  std::vector<IdentifiedCoil> coils{};
  // rad, of either coordinate of the field's direction at the currents in use: rms of their sigmas
  double direction_believed = 0;
  double direction_sigma = 0;
  Unexplained fitted{};
  Unexplained held_out{};  // of the motions that were not fitted; no rows where there was none
  /// Of the unknowns over their prior sigmas: a coil's moment along and across twice, its place;
  /// background, response, sink. Where more was left over than `unexplained` says, it is larger by
  /// that.
  Eigen::MatrixXd covariance{};
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

/// Coils of one dipole each, and the uniform field without current.
struct DipoleModel {
  CoilField field;
  Eigen::Vector3d background{0, 0, 0};  // T
};

/// A model of dipoles as such, also where it was read from a file as multipoles of the first order
/// with one source a coil. Nothing where it is more than that.
std::optional<DipoleModel> dipoles_of(const FieldModel& model);

}  // namespace vitreo::control
