// SPDX-License-Identifier: Apache-2.0
#include "optics/numerics/linear.h"

#include <Eigen/Eigenvalues>
#include <Eigen/QR>

namespace vitreo::optics::detail {

// One solution for each column of b. Columns of a that depend on others get a zero (a basic
// solution), not the least norm.
Eigen::MatrixXd least_squares(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b) {
  // QR keeps the condition of A; the normal equations would square it.
  return a.colPivHouseholderQr().solve(b);
}

// Eigenvalues ascend, so column 0 is the direction of least spread.
Spectrum spectrum_of(const Eigen::MatrixXd& symmetric) {
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(symmetric);
  return {solver.eigenvalues(), solver.eigenvectors()};
}

// By eigenvalues, so the root is symmetric too; a negative eigenvalue makes it a NaN.
Eigen::Matrix2d square_root(const Eigen::Matrix2d& definite) {
  return Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d>(definite).operatorSqrt();
}

}  // namespace vitreo::optics::detail
