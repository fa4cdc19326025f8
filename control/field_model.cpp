// SPDX-License-Identifier: Apache-2.0
#include "control/field_model.h"

#include "control/preconditions.h"

namespace vitreo::control {

int FieldModel::coils() const {
  return std::visit([](const auto& model) { return model.coils(); }, model_);
}

// T/A and T/m/A. Outside of a multipole model's region std::domain_error.
FieldMatrix FieldModel::matrix(const Eigen::Vector3d& position_in_world) const {
  return std::visit([&](const auto& model) { return model.matrix(position_in_world); }, model_);
}

// Dipoles stand for coils and have no field without a current; a multipole model may have sources
// of its own.
FieldGradient FieldModel::background(const Eigen::Vector3d& position_in_world) const {
  FieldGradient field = FieldGradient::Zero();
  if (const auto* multipoles = std::get_if<MultipoleField>(&model_))
    field = multipoles->background(position_in_world);
  field.head<3>() += uniform_;
  return field;
}

// What a probe shows with all coils off: the earth, an instrument beside.
void FieldModel::set_uniform_background(const Eigen::Vector3d& field) {
  require(field.allFinite(), "background field: not finite");
  uniform_ = field;
}

// A fit is an interpolation: outside the box of its readings the multipoles may be anything.
// Dipoles hold everywhere outside of the coils.
bool FieldModel::valid_at(const Eigen::Vector3d& position_in_world) const {
  const auto* multipoles = std::get_if<MultipoleField>(&model_);
  return position_in_world.allFinite() &&
         (!multipoles || multipoles->region().contains(position_in_world));
}

// The nearest point of a box: each coordinate clamped.
// For the loop: a robot a little outside of the region is better steered with the field at its edge
// than not at all.
Eigen::Vector3d FieldModel::nearest_valid(const Eigen::Vector3d& position_in_world) const {
  const auto* multipoles = std::get_if<MultipoleField>(&model_);
  if (!multipoles) return position_in_world;
  return position_in_world.cwiseMax(multipoles->region().low).cwiseMin(multipoles->region().high);
}

}  // namespace vitreo::control
