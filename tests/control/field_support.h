// Support of the field models' tests: high-order differences and positions.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/coil_field.h"

#include <Eigen/Core>

#include <random>

namespace vitreo::control {

inline Eigen::Vector3d place_within(std::mt19937_64& random, double half_side) {
  std::uniform_real_distribution<double> place(-half_side, half_side);
  const double x = place(random), y = place(random), z = place(random);
  return {x, y, z};
}

inline Eigen::Vector3d any_direction(std::mt19937_64& random) {
  std::normal_distribution<double> normal;
  const double x = normal(random), y = normal(random), z = normal(random);
  return Eigen::Vector3d(x, y, z).normalized();
}

/// G(i, j) = dB_i/dx_j by an eighth-order central difference of `field`, a function from place to
/// Vector3d.
template <typename Field>
Eigen::Matrix3d differenced_gradient(const Field& field, const Eigen::Vector3d& p, double h) {
  Eigen::Matrix3d g;
  for (int axis = 0; axis < 3; ++axis) {
    const Eigen::Vector3d e = h * Eigen::Vector3d::Unit(axis);
    const auto odd = [&](int k) { return Eigen::Vector3d(field(p + k * e) - field(p - k * e)); };
    g.col(axis) = (672 * odd(1) - 168 * odd(2) + 32 * odd(3) - 3 * odd(4)) / (840 * h);
  }
  return g;
}

}  // namespace vitreo::control
