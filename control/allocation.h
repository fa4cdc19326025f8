// Wrench allocation: coil currents for a wanted field and force, by the pseudo-inverse.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/coil_field.h"

namespace vitreo::control {

/// Wanted field and force at the robot, world frame.
struct FieldAndForce {
  Eigen::Vector3d field{0, 0, 0};  // T
  // N: balances the robot's net weight; kept before the rest
  Eigen::Vector3d levitation{0, 0, 0};
  Eigen::Vector3d force{0, 0, 0};  // N, on top of it
};

struct Allocation {
  Currents currents;       // A
  double force_scale = 1;  // of `force`, where a limit cut it
  double field_scale = 1;  // of `field`, cut only when no force is left to cut
  bool limited() const { return force_scale < 1 || field_scale < 1; }
};

/// Least-norm I with [B; F] = A I (Kummer et al. 2010; facts/magnetics 2), |I_k| <= limit. At a
/// limit the extra force is shrunk first, then the field's magnitude; the levitation never. Throws
/// std::domain_error when A has not full rank (dead coils, no moment), or when the levitation is
/// beyond the limit however small the rest; std::invalid_argument naming the argument that is not
/// finite, or a limit not above zero. `moment` (A m^2, world) is taken as given: a soft robot's
/// falls with the field, so after a cut of the field the caller asks again with the moment of the
/// cut field.
Allocation allocate(const FieldMatrix& matrix, const Eigen::Vector3d& moment,
                    const FieldAndForce& wanted, double limit);

}  // namespace vitreo::control
