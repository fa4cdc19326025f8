// SPDX-License-Identifier: Apache-2.0
#include "control/vitreous.h"

#include "control/constants.h"
#include "control/measured_gel.h"
#include "control/preconditions.h"
#include "control/robots.h"

#include <array>
#include <cmath>
#include <stdexcept>

namespace vitreo::control {
namespace {

// Thesis tables 7.1 and 7.2: agar of the artificial vitreous humors, case 1 to 11.
constexpr std::array kAgar = {1.098, 1.27,  1.42, 1.56, 1.68, 1.80,
                              1.91,  2.014, 2.11, 2.21, 2.30};  // mg/mL
// In its cavity, and after an hour outside, five times softer (Nickerson et al. 2008;
// facts/magnetics 3.2).
constexpr double kPorcineModulus = 14;   // Pa
constexpr double kRemovedModulus = 2.8;  // Pa
// The thesis has no moduli in numbers: this exponent, with the yield strain, is fitted to which
// robot moves in which case (facts/magnetics 3.2).
constexpr double kAgarExponent = 2.6;

}  // namespace

void Gel::check() const {
  require(positive(storage_modulus), "gel storage_modulus: must be above 0 Pa");
  require(positive(yield_strain), "gel yield_strain: must be above 0");
  require(positive(solvent_viscosity), "gel solvent_viscosity: must be above 0 Pa s");
  require(positive(plastic_viscosity), "gel plastic_viscosity: must be above 0 Pa s");
  require(positive(density), "gel density: must be above 0 kg/m^3");
}

// Throws std::invalid_argument for a case that the tables do not have.
Gel artificial_vitreous(int number) {
  require(number >= 1 && number <= static_cast<int>(kAgar.size()),
          "gel: a case from 1 to 11 is wanted");
  Gel gel;
  gel.name = "gel_" + std::to_string(number);
  const double agar = kAgar[static_cast<std::size_t>(number - 1)];
  gel.storage_modulus = kPorcineModulus * std::pow(agar / kAgar.front(), kAgarExponent);
  return gel;
}

const std::vector<std::string>& gel_names() {
  static const std::vector<std::string> names = [] {
    std::vector<std::string> list;
    for (std::size_t number = 1; number <= kAgar.size(); ++number)
      list.push_back("gel_" + std::to_string(number));
    list.insert(list.end(), {"porcine_vitreous", "porcine_vitreous_removed"});
    return list;
  }();
  return names;
}

// By name, or std::invalid_argument with the names that there are.
Gel gel_named(std::string_view name) {
  if (const auto measured = rheometry_in(name)) return gel_of(*measured);
  const auto& names = gel_names();
  for (std::size_t k = 0; k < kAgar.size(); ++k)
    if (names[k] == name) return artificial_vitreous(static_cast<int>(k) + 1);
  Gel gel;
  gel.name = name;
  gel.storage_modulus = name == "porcine_vitreous" ? kPorcineModulus : kRemovedModulus;
  if (name == "porcine_vitreous" || name == "porcine_vitreous_removed") return gel;
  std::string known;
  for (const std::string& own : names) known += (known.empty() ? "" : ", ") + own;
  throw std::invalid_argument("gel: '" + std::string(name) + "' is not one of " + known);
}

// Coefficients of the Maxwell element with a Bingham slider, beside a solvent (facts/magnetics
// 3.2), of the sphere of mean radius r = (a b^2)^(1/3): c = 6 pi eta_s r, k = 6 pi G' r, c_p = 6 pi
// eta_p r, so that only the ratios k/c = G'/eta_s and k/c_p = G'/eta_p are needed beside c. The
// torque's yield limit, 3.5 pi a b^2 tau_y, is assumed (docs/simulated_laboratory.md).
// Throws std::invalid_argument naming the parameter. It starts relaxed: the network carries no
// stress.
EmbeddedRobot::EmbeddedRobot(const Robot& robot, const Gel& gel)
    : semi_axis_(robot.semi_axis),
      semi_radius_(robot.semi_radius),
      yield_stress_(gel.yield_stress()) {
  robot.check();
  gel.check();
  yield_torque_ = 3.5 * kPi * semi_axis_ * semi_radius_ * semi_radius_ * yield_stress_;
  const Medium solvent{"solvent", gel.density, gel.solvent_viscosity / gel.density};
  drag_ = 6 * kPi * gel.solvent_viscosity * std::cbrt(semi_axis_ * semi_radius_ * semi_radius_);
  turning_drag_ = rotational_resistance(robot, solvent);
  elastic_ = gel.storage_modulus / gel.solvent_viscosity;
  plastic_ = gel.storage_modulus / gel.plastic_viscosity;
}

// The silhouette of a spheroid at the angle th to its axis: pi b sqrt(b^2 cos^2 th + a^2 sin^2 th).
// 14 = 2 / Y_c with the critical yield number 0.143 of a sphere (Beris et al. 1985).
// N. Both vectors are of unit length.
double EmbeddedRobot::yield_force(const Eigen::Vector3d& axis,
                                  const Eigen::Vector3d& direction) const {
  const double along = axis.dot(direction);
  const double along2 = std::min(along * along, 1.0);
  const double silhouette =
      kPi * semi_radius_ *
      std::sqrt(semi_radius_ * semi_radius_ * along2 + semi_axis_ * semi_axis_ * (1 - along2));
  return 14 * yield_stress_ * silhouette;
}

EmbeddedRobot::Rates EmbeddedRobot::step(const Eigen::Vector3d& axis, const Eigen::Vector3d& force,
                                         const Eigen::Vector3d& torque, double stiffness,
                                         double span) {
  // Backward Euler over h = `span` with a return to the yield surface (Simo & Hughes 1998), of
  //   s' = k (v - v_p), v = (F - s) / c, v_p = (1 - 1/f) s / c_p where f > 1,
  // with alpha = h k/c and beta = h k/c_p: s1 (1 + alpha + beta (1 - 1/f1)) = s0 + alpha F. The
  // ratios are the same for force and torque, so both scale by one factor, s1 = g (s0 + alpha F),
  // and f1 = g f_trial obeys f1 (1 + alpha) + beta (f1 - 1) = f_trial beyond the surface, f1 > 1.
  // Within it g = 1 / (1 + alpha).
  const double alpha = span * elastic_;
  const double beta = span * plastic_;
  const double reach = span / turning_drag_;
  const Eigen::Vector3d s = force_ + alpha * force;
  const double size = s.norm();
  const double force_part = size > 0 ? size / yield_force(axis, s / size) : 0;
  const double asked = torque.norm();
  const Eigen::Vector3d about =
      asked > 0 ? Eigen::Vector3d(torque / asked) : Eigen::Vector3d::Zero();
  double g = 1 / (1 + alpha);
  Eigen::Vector3d turned = torque;
  Eigen::Vector3d t = torque_;
  // The torque depends on the angle turned, and so on g: a fixed-point iteration, four passes.
  for (int pass = 0; pass < 4; ++pass) {
    // The torque at the step's end, T1 = T - stiffness * (angle turned about it), given g.
    const double end = (asked + stiffness * reach * g * torque_.dot(about)) /
                       (1 + stiffness * reach * (1 - g * alpha));
    turned = end * about;
    t = torque_ + alpha * turned;
    const double trial = std::hypot(force_part, t.norm() / yield_torque_);
    g = trial <= 1 + alpha ? 1 / (1 + alpha) : (trial + beta) / (1 + alpha + beta) / trial;
  }
  force_ = g * s;
  torque_ = g * t;
  return {(force - force_) / drag_, (turned - torque_) / turning_drag_};
}

}  // namespace vitreo::control
