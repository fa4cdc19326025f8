// One field model or the other: dipoles or multipoles, with the field that is there without
// current.
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
  // Not explicit: wherever a model is asked for, either kind will do.
  FieldModel(CoilField dipoles)
      : model_(std::move(dipoles)) {}  // NOLINT(google-explicit-constructor)
  FieldModel(MultipoleField multipoles)
      : model_(std::move(multipoles)) {}  // NOLINT(google-explicit-constructor)
  int coils() const;
  /// As CoilField::matrix and MultipoleField::matrix; std::domain_error outside a multipole model's
  /// region.
  FieldMatrix matrix(const Eigen::Vector3d& position_in_world) const;
  /// T and T/m without current: the multipole model's own plus the uniform one set here.
  FieldGradient background(const Eigen::Vector3d& position_in_world) const;
  /// The earth and the neighbors: T, world. Throws std::invalid_argument when not finite.
  void set_uniform_background(const Eigen::Vector3d& field);
  /// Dipoles are good everywhere but at the coils.
  bool valid_at(const Eigen::Vector3d& position_in_world) const;
  const CoilField* dipoles() const {
    return std::get_if<CoilField>(&model_);
  }  ///< null for multipoles
  const MultipoleField* multipoles() const {
    return std::get_if<MultipoleField>(&model_);
  }                                                                       ///< null for dipoles
  const Eigen::Vector3d& uniform_background() const { return uniform_; }  ///< T
  /// The place of the model's region that is nearest: where to ask in place of one outside.
  Eigen::Vector3d nearest_valid(const Eigen::Vector3d& position_in_world) const;

 private:
  std::variant<CoilField, MultipoleField> model_;
  Eigen::Vector3d uniform_{0, 0, 0};
};

}  // namespace vitreo::control
