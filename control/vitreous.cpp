// SPDX-License-Identifier: Apache-2.0
#include "control/vitreous.h"

#include "control/robots.h"

#include <array>
#include <cmath>
#include <numbers>
#include <stdexcept>

namespace vitreo::control {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr std::array kAgar = {1.098, 1.27,  1.42, 1.56, 1.68, 1.80,
                              1.91,  2.014, 2.11, 2.21, 2.30};  // mg/mL
constexpr double kPorcineModulus = 14, kRemovedModulus = 2.8;   // Pa
constexpr double kAgarExponent = 2.6;

void require(bool good, const char* what) {
  if (!good) throw std::invalid_argument(what);
}

bool positive(double value) { return std::isfinite(value) && value > 0; }

}  // namespace

void Gel::check() const {
  require(positive(storage_modulus), "gel storage_modulus: must be above 0 Pa");
  require(positive(yield_strain), "gel yield_strain: must be above 0");
  require(positive(solvent_viscosity), "gel solvent_viscosity: must be above 0 Pa s");
  require(positive(plastic_viscosity), "gel plastic_viscosity: must be above 0 Pa s");
  require(positive(density), "gel density: must be above 0 kg/m^3");
}

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

Gel gel_named(std::string_view name) {
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

double EmbeddedRobot::yield_force(const Eigen::Vector3d& axis,
                                  const Eigen::Vector3d& direction) const {
  const double along = axis.dot(direction), along2 = std::min(along * along, 1.0);
  const double silhouette =
      kPi * semi_radius_ *
      std::sqrt(semi_radius_ * semi_radius_ * along2 + semi_axis_ * semi_axis_ * (1 - along2));
  return 14 * yield_stress_ * silhouette;
}

EmbeddedRobot::Rates EmbeddedRobot::step(const Eigen::Vector3d& axis, const Eigen::Vector3d& force,
                                         const Eigen::Vector3d& torque, double stiffness,
                                         double span) {
  // Backwards Euler. k / c = G' / eta_s and k / c_p = G' / eta_p hold for force and torque alike,
  // so that both scale by one factor g: s1 = g (s0 + alpha F), with f1 (1 + alpha) + beta (f1 - 1)
  // = f_trial beyond the yield surface.
  const double alpha = span * elastic_, beta = span * plastic_, reach = span / turning_drag_;
  const Eigen::Vector3d s = force_ + alpha * force;
  const double size = s.norm(), force_part = size > 0 ? size / yield_force(axis, s / size) : 0;
  const double asked = torque.norm();
  const Eigen::Vector3d about =
      asked > 0 ? Eigen::Vector3d(torque / asked) : Eigen::Vector3d::Zero();
  double g = 1 / (1 + alpha);
  Eigen::Vector3d turned = torque, t = torque_;
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
