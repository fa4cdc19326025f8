// Decompositions of small matrices where speed does not matter, compiled once: Eigen's templates
// cost seconds a source.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

namespace vitreo::optics::detail {

/// The x of least |A x - b|, column by column, by QR with column pivoting. A: rows x n; b: rows x
/// k; n x k.
Eigen::MatrixXd least_squares(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b);

/// Of a symmetric matrix: eigenvalues ascending, eigenvectors of unit length as columns.
struct Spectrum {
  Eigen::VectorXd values;
  Eigen::MatrixXd vectors;
};
Spectrum spectrum_of(const Eigen::MatrixXd& symmetric);

/// The symmetric positive definite root of a symmetric positive definite 2x2 matrix.
Eigen::Matrix2d square_root(const Eigen::Matrix2d& definite);

}  // namespace vitreo::optics::detail
