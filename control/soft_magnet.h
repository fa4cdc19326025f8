// Magnetization of a soft ellipsoid: demagnetizing factors, shape anisotropy and saturation.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

namespace vitreo::control {

/// Demagnetizing factors of an ellipsoid with the semi-axes given (Carlson's integrals); they sum
/// to 1.
Eigen::Vector3d demagnetizing_factors(const Eigen::Vector3d& semi_axes);

/// A soft ellipsoid's body: factors about its own axes, the first along the robot's.
struct SoftBody {
  double volume = 0;                                // m^3
  double saturation = 0;                            // A/m
  Eigen::Vector3d factors{1. / 3, 1. / 3, 1. / 3};  // demagnetizing
  void check() const;  // throws std::invalid_argument naming the parameter
};

/// Moment (A m^2, in the body's frame) in the field `field_in_body` (T), the susceptibility far
/// above 1: linear M = H / N as long as |M| < saturation, else |M| = saturation in the direction
/// that minimizes mu0/2 M.N M - mu0 M.H (Abbott et al. 2007). Torque m x B and force (m.grad) B
/// follow.
Eigen::Vector3d soft_moment(const SoftBody& body, const Eigen::Vector3d& field_in_body);

}  // namespace vitreo::control
