// SPDX-License-Identifier: Apache-2.0
#include "control/robot.h"

#include "control/constants.h"
#include "control/preconditions.h"
#include "control/soft_magnet.h"

#include <cmath>
#include <cstddef>

namespace vitreo::control {
namespace {

struct PerrinDrag {
  double along;   // N s/m
  double across;  // N s/m
};

// Stokes drag of a prolate spheroid (Oberbeck 1876, Perrin 1936; facts/magnetics 3.1) with a the
// semi-axis, e the eccentricity, q = a e and S = (2/q) ln((a + q)/b) = (2/q) artanh e:
//   f_par = 16 pi eta q^2 / ((2a^2 - b^2) S - 2a), f_perp = 32 pi eta q^2 / ((2a^2 - 3b^2) S + 2a).
// Both denominators vanish as e^2 when the axes become equal; divided by 2 a e^2 they are the
// series below, by artanh e = sum e^(2n+1) / (2n + 1). At the sphere: 6 pi eta a, Stokes.
// `a` along the axis and `b` across, m; a >= b.
PerrinDrag perrin(double viscosity, double a, double b) {
  const double e2 = (a - b) * (a + b) / (a * a);
  double along = 0;   // denominator of f_par over 2 a e^2
  double across = 0;  // denominator of f_perp over 2 a e^2
  if (e2 < 0.05) {
    double power = 1;
    for (int n = 0; n < 12; ++n, power *= e2) {  // 0.05^12 is below the rounding of a double
      along += power * (1.0 / (2 * n + 1) + 1.0 / (2 * n + 3));
      across += power * (3.0 / (2 * n + 1) - 1.0 / (2 * n + 3));
    }
  } else {
    const double e = std::sqrt(e2);
    const double s = 2 * std::log((1 + e) * a / b) / e;  // a S
    along = ((1 + e2) * s - 2) / (2 * e2);
    across = ((3 * e2 - 1) * s + 2) / (2 * e2);
  }
  return {8 * kPi * viscosity * a / along, 16 * kPi * viscosity * a / across};
}

}  // namespace

const char* to_string(BodyShape shape) {
  constexpr const char* kNames[] = {"ellipsoid", "crossed plates", "cylinder", "sphere", "disc"};
  return kNames[static_cast<std::size_t>(shape)];
}

// Throws std::invalid_argument naming the parameter.
void Medium::check() const {
  require(positive(density), "medium density: must be above 0 kg/m^3");
  require(positive(kinematic_viscosity), "medium kinematic_viscosity: must be above 0 m^2/s");
}

void Robot::check() const {
  require(positive(semi_axis), "robot semi_axis: must be above 0 m");
  require(positive(semi_radius), "robot semi_radius: must be above 0 m");
  require(semi_axis >= semi_radius,
          "robot semi_axis: must be at least semi_radius (the robot is elongated)");
  require(positive(solid_volume), "robot solid_volume: must be above 0 m^3");
  require(solid_volume <=
              2 * kPi * semi_axis * semi_radius * semi_radius * (1 + 1e-9),  // a full cylinder
          "robot solid_volume: more metal than its outline holds");
  require(positive(solid_density), "robot solid_density: must be above 0 kg/m^3");
  require(positive(saturation), "robot saturation: must be above 0 A/m");
  require(positive(drag_along), "robot drag_along: must be above 0");
  require(positive(drag_across), "robot drag_across: must be above 0");
  require(positive(moment_factor), "robot moment_factor: must be above 0");
  require(hard || (positive(demagnetization) && demagnetization < 1),
          "robot demagnetization: must be within 0 and 1 for a soft magnet");
  require(std::isfinite(anisotropy) && anisotropy >= 0 && demagnetization + anisotropy < 1,
          "robot anisotropy: must be at least 0 and leave the factor across the axis below 1");
  if (helix) helix->check();
  if (tail) tail->check();
  require(!(helix || tail) || hard, "robot helix, tail: the magnet must be a permanent one (hard)");
  require(!(helix && tail), "robot tail: a helix has none");
}

// Hard: V Br / mu0. Soft: a smooth passage from the linear law H / N to saturation,
// M = Ms tanh(H / (N Ms)) (facts/magnetics 2).
// A hard magnet's moment does not change with the field; `field` is checked in any case, so that a
// NaN never passes.
double Robot::moment(double field) const {
  require(std::isfinite(field) && field >= 0, "field: a magnitude, must be at least 0 T");
  const double full = moment_factor * solid_volume * saturation;
  return hard ? full : full * std::tanh(field / (kMu0 * demagnetization * saturation));
}

// Of the metal alone: the liquid fills what the outline encloses.
double Robot::net_weight(const Medium& medium) const {
  return solid_volume * (solid_density - medium.density) * kGravity;
}

Robot coni_2mm() {
  // Two elliptical plates, 2 x 1 mm and 42 um thick, that cross along the major axis and share a
  // bar there.
  constexpr double kThickness = 42e-6;
  constexpr double kAxis = 1e-3;
  constexpr double kRadius = 0.5e-3;
  Robot robot;
  robot.name = "CoNi 2 mm";
  robot.shape = BodyShape::crossed_plates;
  robot.semi_axis = kAxis;
  robot.semi_radius = kRadius;
  // 0.128 mm^3
  robot.solid_volume = 2 * kPi * kAxis * kRadius * kThickness - 2 * kAxis * kThickness * kThickness;
  robot.solid_density = 8800;
  robot.saturation = 1.19e6;
  // N from the table's m(20 mT) = 7.3e-5 A m^2 (facts/magnetics 3.1) by the tanh law: crossed
  // plates have no demagnetizing factor in closed form.
  const double share = 7.3e-5 / (robot.solid_volume * robot.saturation);
  robot.demagnetization = 0.02 / (kMu0 * robot.saturation * std::atanh(share));
  // That of one plate within its plane, N_b - N_a: 1/2 mu0 V Ms^2 times this is the largest torque,
  // 2.6e-6 N m (facts/magnetics 3.2: 2.1e-6).
  const Eigen::Vector3d plate = demagnetizing_factors({kAxis, kRadius, kThickness / 2});
  robot.anisotropy = plate[1] - plate[0];
  return robot;
}

// R = f_perp 1 + (f_par - f_perp) n n'.
// In the world frame, symmetric and positive definite, so that its inverse, the mobility, exists.
Eigen::Matrix3d resistance(const Robot& robot, const Medium& medium, const Eigen::Vector3d& axis) {
  robot.check();
  medium.check();
  const double length = axis.norm();
  require(positive(length), "axis: must be finite and not zero");
  PerrinDrag drag = perrin(medium.dynamic_viscosity(), robot.semi_axis, robot.semi_radius);
  if (robot.helix) {
    const HelixResistance helix = helix_resistance(*robot.helix, medium.dynamic_viscosity());
    drag = {helix.along, helix.across};
  }
  if (robot.tail) {
    const TailDrag tail = tail_drag(*robot.tail, medium.dynamic_viscosity());
    drag = {tail.along, tail.across};
  }
  const Eigen::Vector3d n = axis / length;
  const double along = robot.drag_along * drag.along;
  const double across = robot.drag_across * drag.across;
  return across * Eigen::Matrix3d::Identity() + (along - across) * n * n.transpose();
}

}  // namespace vitreo::control
