// Nonlinear least squares of the field fits: Ceres with one set of options.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include <memory>
#include <vector>

namespace ceres {
class CostFunction;
}

namespace vitreo::control {

constexpr double kFieldUnit = 1e-3;  // T: scale of the residuals, which are then about one
/// A Jacobian as Ceres stores it, row by row.
using Jacobian = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

/// Minimizes 1/2 |r(x)|^2 from `x`, which becomes the minimum, by Levenberg-Marquardt. `residuals`
/// has one parameter block, of the size of `x`, and its own derivatives; residuals and unknowns
/// should be scaled to about one. Returns whether it converged within 200 iterations.
bool solve_least_squares(std::unique_ptr<ceres::CostFunction> residuals, std::vector<double>& x);

}  // namespace vitreo::control
