// Microrobot and medium: magnet, weight and drag.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/flexible_tail.h"
#include "control/helix.h"

#include <Eigen/Core>

#include <optional>
#include <string>

namespace vitreo::control {

constexpr double kGravity = 9.80665;  // m/s^2

struct Medium {
  std::string name = "silicone oil";
  double density = 970;                 // kg/m^3
  double kinematic_viscosity = 500e-6;  // m^2/s (1 cSt = 1e-6)
  double dynamic_viscosity() const { return density * kinematic_viscosity; }  // Pa s
  void check() const;  // throws std::invalid_argument naming the parameter
};

/// Shape of a body's surface. A disc is a cylinder that is wider than long.
enum class BodyShape { ellipsoid, crossed_plates, cylinder, sphere, disc };
const char* to_string(BodyShape shape);

/// An elongated robot: a prolate spheroid for fluid and optics.
struct Robot {
  std::string name;
  BodyShape shape = BodyShape::ellipsoid;  // of its surface (control/clearance.h)
  double semi_axis = 1e-3;                 // m, along the axis
  double semi_radius = 0.5e-3;             // m, across
  double solid_volume = 0;                 // m^3 of metal
  double solid_density = 0;                // kg/m^3
  double saturation = 0;       // A/m: saturation magnetization (soft) or remanence/mu0 (hard)
  double demagnetization = 0;  // along the easy axis; 0 with `hard`
  bool hard = false;           // a permanent magnet
  /// Identified factors (control/robot_identification.h): of the drag of its outline, along its
  /// axis and across, and of the moment of its volume.
  double drag_along = 1;
  double drag_across = 1;
  double moment_factor = 1;
  double anisotropy = 0;  // of a soft magnet: the factor across the axis less the one along it
  // A helical swimmer, whose moment is across the axis. Else that is along it, and the body a
  // spheroid; for the optics a helix is the spheroid about it.
  std::optional<Helix> helix{};
  // A swimmer with a flexible tail, whose moment is along the axis, towards the head.
  std::optional<FlexibleTail> tail{};
  void check() const;  // throws std::invalid_argument naming the parameter
  /// |m| in A m^2 along the axis at the field |B| in T: hard, or soft as V Ms tanh(B / (mu0 N Ms)).
  double moment(double field) const;
  double mass() const { return solid_volume * solid_density; }  // kg
  /// Weight less buoyancy, N, positive downwards: (rho_s - rho_f) V g.
  double net_weight(const Medium& medium) const;
};

/// The 2 mm x 1 mm x 1 mm robot of two crossed elliptical CoNi plates (facts/magnetics 3.1).
Robot coni_2mm();

/// Resistance R in f = R v, N s/m: Perrin's prolate spheroid with its axis along `axis` (world, of
/// any length). Throws std::invalid_argument for an axis that is not finite or zero.
Eigen::Matrix3d resistance(const Robot& robot, const Medium& medium, const Eigen::Vector3d& axis);

}  // namespace vitreo::control
