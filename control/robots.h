// Named microrobots, drag beside walls and in turning, and the magnetic moment in any direction.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/robot.h"
#include "control/soft_magnet.h"

#include <Eigen/Core>

#include <string_view>
#include <vector>

namespace vitreo::control {

Robot ni_500um();            ///< 0.5 x 0.25 x 0.25 mm of two crossed Ni plates
Robot ndfeb_sphere_500um();  ///< a permanent magnet, 0.5 mm
Robot helix_2mm();           ///< a resin helix of two turns about a magnet of 0.25 mm
Robot tail_3mm();            ///< a flexible tail of 2.3 mm behind a head that hardly sinks
Robot ndfeb_cylinder_1mm();  ///< a permanent magnet, 1 mm x 0.5 mm, magnetized along its axis

/// coni_2mm, ni_500um, ndfeb_sphere_500um, ndfeb_cylinder_1mm, helix_2mm,
/// tail_3mm.
const std::vector<std::string_view>& robot_names();
/// Throws std::invalid_argument with the names there are.
Robot robot_named(std::string_view name);

/// By how much a plane wall multiplies a sphere's drag (Faxen), `distance` (m, above 0) from its
/// center: along the wall 1 / (1 - 9R/16h + R^3/8h^3), towards it 1 / (1 - 9R/8h + R^3/2h^3).
/// Nearer than 1.155 R the second turns round and is not true: as at 1.155 R.
struct WallFactors {
  double along;
  double towards;
};
WallFactors faxen(double radius, double distance);

/// `free` (N s/m, as `resistance` gives it) beside a plane wall, by Faxen's factors for the sphere
/// of the robot's mean radius R = (a b^2)^(1/3). `normal` (unit) points from the wall to the robot.
/// Throws std::invalid_argument for a distance not above 0 or a normal that is no direction.
Eigen::Matrix3d resistance_near_wall(const Eigen::Matrix3d& free, const Robot& robot,
                                     const Eigen::Vector3d& normal, double distance);

/// Torque per rate of turning across the axis, N m s (Perrin's z_rot, facts/magnetics 3.1).
double rotational_resistance(const Robot& robot, const Medium& medium);

/// The moment (A m^2, world) in any field (T, world) of a robot whose axis (unit, world) need not
/// lie along it. Hard: along the axis, the sense of `axis`. Soft: soft_moment's direction, with its
/// factors along and across, and the knee at saturation rounded as in Robot::moment, which this is
/// where field and axis agree. Torque m x B, force (m.grad) B.
Eigen::Vector3d robot_moment(const Robot& robot, const Eigen::Vector3d& axis,
                             const Eigen::Vector3d& field);

}  // namespace vitreo::control
