// SPDX-License-Identifier: Apache-2.0
#include "control/field_model.h"

#include "control/preconditions.h"

namespace vitreo::control {

int FieldModel::coils() const {
  return std::visit([](const auto& model) { return model.coils(); }, model_);
}

FieldMatrix FieldModel::matrix(const Eigen::Vector3d& position_in_world) const {
  return std::visit([&](const auto& model) { return model.matrix(position_in_world); }, model_);
}

FieldGradient FieldModel::background(const Eigen::Vector3d& position_in_world) const {
  FieldGradient field = FieldGradient::Zero();
  if (const auto* multipoles = std::get_if<MultipoleField>(&model_))
    field = multipoles->background(position_in_world);
  field.head<3>() += uniform_;
  return field;
}

void FieldModel::set_uniform_background(const Eigen::Vector3d& field) {
  require(field.allFinite(), "background field: not finite");
  uniform_ = field;
}

// A fit is an interpolation: outside the box of its readings the multipoles may be anything.
bool FieldModel::valid_at(const Eigen::Vector3d& position_in_world) const {
  const auto* multipoles = std::get_if<MultipoleField>(&model_);
  return position_in_world.allFinite() &&
         (!multipoles || multipoles->region().contains(position_in_world));
}

// The nearest point of a box: each coordinate clamped.
Eigen::Vector3d FieldModel::nearest_valid(const Eigen::Vector3d& position_in_world) const {
  const auto* multipoles = std::get_if<MultipoleField>(&model_);
  if (!multipoles) return position_in_world;
  return position_in_world.cwiseMax(multipoles->region().low).cwiseMin(multipoles->region().high);
}

}  // namespace vitreo::control
