// Field model: dipoles or multipoles, with the background field at zero current.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/coil_field.h"
#include "control/multipole_field.h"

#include <Eigen/Core>

#include <utility>
#include <variant>

namespace vitreo::control {

/// A value: copy it, one for the controller and one for the truth.
class FieldModel {
 public:
  // Not explicit: either kind converts wherever a model is wanted.
  // NOLINTNEXTLINE(google-explicit-constructor)
  FieldModel(CoilField dipoles) : model_(std::move(dipoles)) {}
  // NOLINTNEXTLINE(google-explicit-constructor)
  FieldModel(MultipoleField multipoles) : model_(std::move(multipoles)) {}
  int coils() const;
  /// As CoilField::matrix and MultipoleField::matrix; std::domain_error outside a multipole model's
  /// region.
  FieldMatrix matrix(const Eigen::Vector3d& position_in_world) const;
  /// T and T/m without current: the multipole model's own plus the uniform one set here.
  FieldGradient background(const Eigen::Vector3d& position_in_world) const;
  /// The field of the earth and of other apparatus: T, world. Throws std::invalid_argument when not
  /// finite.
  void set_uniform_background(const Eigen::Vector3d& field);
  /// Whether the model holds at a position: dipoles everywhere, multipoles in their region.
  bool valid_at(const Eigen::Vector3d& position_in_world) const;
  /// Null for multipoles.
  const CoilField* dipoles() const { return std::get_if<CoilField>(&model_); }
  /// Null for dipoles.
  const MultipoleField* multipoles() const { return std::get_if<MultipoleField>(&model_); }
  const Eigen::Vector3d& uniform_background() const { return uniform_; }  ///< T
  /// The nearest position in the model's region; the position itself inside it, and for dipoles.
  Eigen::Vector3d nearest_valid(const Eigen::Vector3d& position_in_world) const;

 private:
  std::variant<CoilField, MultipoleField> model_;
  Eigen::Vector3d uniform_{0, 0, 0};
};

}  // namespace vitreo::control
