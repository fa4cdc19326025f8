// SPDX-License-Identifier: Apache-2.0
#include "optics/detail/linear.h"

#include <Eigen/Eigenvalues>
#include <Eigen/QR>

#include <cmath>

namespace vitreo::optics::detail {

Eigen::MatrixXd least_squares(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b) {
  return a.colPivHouseholderQr().solve(b);
}

Spectrum spectrum_of(const Eigen::MatrixXd& symmetric) {
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(symmetric);
  return {solver.eigenvalues(), solver.eigenvectors()};
}

Eigen::Matrix2d square_root(const Eigen::Matrix2d& definite) {
  const double root = std::sqrt(definite(0, 0) * definite(1, 1) - definite(0, 1) * definite(1, 0));
  return (definite + root * Eigen::Matrix2d::Identity()) / std::sqrt(definite.trace() + 2 * root);
}

}  // namespace vitreo::optics::detail
