// Convex quadratic program in a box and on one plane, for up to eight unknowns: min 1/2 x'Hx - c'x.
// Plain arrays, no heap.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

namespace vitreo::control {

constexpr int kMaxUnknowns = 8;

struct BoxProgram {
  int size = 0;
  Eigen::Matrix<double, kMaxUnknowns, kMaxUnknowns> curvature;  // H, positive definite
  Eigen::Matrix<double, kMaxUnknowns, 1> slope;                 // c
  Eigen::Matrix<double, kMaxUnknowns, 1> plane;                 // a, of a'x = level
  Eigen::Matrix<double, kMaxUnknowns, 1> limit;  // |x_k| <= limit_k; 0 fixes x_k at 0
};

/// Improves `x`, which must lie in the box and on its own plane, and stays there: the primal
/// active-set method. Returns the iterations done, at most `most`.
int improve(const BoxProgram& program, Eigen::Matrix<double, kMaxUnknowns, 1>& x, int most);

}  // namespace vitreo::control
