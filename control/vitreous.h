// Viscoplastic gel model of the vitreous, for one embedded robot: a Maxwell element with a Bingham
// slider beside a thin solvent (thesis 7.1; facts/magnetics 3.2).
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/robot.h"

#include <Eigen/Core>

#include <string>
#include <string_view>
#include <vector>

namespace vitreo::control {

/// Material parameters. Which are measured and which assumed: docs/simulated_laboratory.md.
struct Gel {
  std::string name;
  double storage_modulus = 14;       // Pa, G'
  double yield_strain = 1.2;         // yield stress over G'
  double solvent_viscosity = 50e-3;  // Pa s
  double plastic_viscosity = 1;      // Pa s, of what has yielded
  double density = 1005;             // kg/m^3
  double yield_stress() const { return yield_strain * storage_modulus; }  // Pa
  void check() const;  // throws std::invalid_argument naming the parameter
};

/// The artificial vitreous humours of thesis tables 7.1 and 7.2, case 1 to 11 (agar from 1.098
/// to 2.30 mg/mL, hyaluronic acid 2.21 mg/mL): G' = 14 Pa (agar / 1.098)^2.6. Throws
/// std::invalid_argument for another case.
Gel artificial_vitreous(int number);
/// gel_1 to gel_11, porcine_vitreous (left in its cavity: 14 Pa), porcine_vitreous_removed (2.8 Pa:
/// the moduli fall five-fold within an hour once it is taken out).
const std::vector<std::string>& gel_names();
/// Throws std::invalid_argument with the known names.
Gel gel_named(std::string_view name);

/// A robot in a gel. The force on it is carried by solvent and network side by side, F = s + c v;
/// the network's part s grows with s' = k (v - v_p) and flows with v_p = (1 - 1/f) s / c_p where
/// f = sqrt((s/F_y)^2 + (t/T_y)^2) is above 1. The same for torque: t, T_y. Force and torque share
/// one yield surface, so a robot that turns fast enough to yield the gel about it can also be
/// pulled through it.
class EmbeddedRobot {
 public:
  /// Throws std::invalid_argument naming a parameter.
  EmbeddedRobot(const Robot& robot, const Gel& gel);
  struct Rates {
    Eigen::Vector3d velocity;  // m/s
    Eigen::Vector3d turning;   // rad/s
  };
  /// One step of `span` s under force and torque that are constant meanwhile; implicit, stable for
  /// any step. `stiffness` (N m/rad): how much the torque falls for each radian turned, so that a
  /// stiff magnet does not overshoot its field.
  Rates step(const Eigen::Vector3d& axis, const Eigen::Vector3d& force,
             const Eigen::Vector3d& torque, double stiffness, double span);
  /// N: the largest steady force along `direction` (unit) that the gel holds without yielding: 14
  /// tau_y times the robot's silhouette seen along it (Beris et al. 1985 for a sphere; 14 pi b^2
  /// tau_y along the axis).
  double yield_force(const Eigen::Vector3d& axis, const Eigen::Vector3d& direction) const;
  double yield_torque() const { return yield_torque_; }  // N m, across the axis: 3.5 pi a b^2 tau_y
  /// Back to the state of a new one: the network has healed and carries no stress.
  void relax() {
    force_.setZero();
    torque_.setZero();
  }

 private:
  double semi_axis_;                 // m
  double semi_radius_;               // m
  double yield_stress_;              // Pa
  double yield_torque_;              // N m
  double drag_;                      // N s/m, of the solvent
  double turning_drag_;              // N m s, of the solvent
  double elastic_;                   // G' / eta_s, 1/s
  double plastic_;                   // G' / eta_p, 1/s
  Eigen::Vector3d force_{0, 0, 0};   // s: N, world
  Eigen::Vector3d torque_{0, 0, 0};  // t: N m, world
};

}  // namespace vitreo::control
