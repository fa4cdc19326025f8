// SPDX-License-Identifier: Apache-2.0
#include "control/field_least_squares.h"

#include <ceres/cost_function.h>
#include <ceres/problem.h>
#include <ceres/solver.h>

namespace vitreo::control {

// True when it converged; x has the last step in any case.
bool solve_least_squares(std::unique_ptr<ceres::CostFunction> residuals, std::vector<double>& x) {
  ceres::Problem problem;
  problem.AddResidualBlock(residuals.release(), nullptr, x.data());  // the problem owns it
  ceres::Solver::Options options;
  // Every reading depends on every unknown, so J is dense. QR does not square its condition, which
  // matters for multipole sources that nearly cancel (facts/magnetics 1.3).
  options.linear_solver_type = ceres::DENSE_QR;
  // A fit that needs more started too far away, and is reported as not converged.
  options.max_num_iterations = 200;
  // The cost is about half the number of residuals, 1e3, in units of the noise, and a parameter off
  // by d of its standard deviations raises it by d^2 / 2. So a change of 1e-12 of it is 5e-5 of a
  // standard deviation: far below what the readings can tell, and far above the rounding, 1e-16,
  // below which a test would never be met.
  options.function_tolerance = 1e-12;
  options.parameter_tolerance = 1e-12;  // of |x|: 1e-13 m of a coil's position
  // Below the gradient's rounding where there is noise: it can end a fit only to exact readings,
  // whose cost falls towards 0, so that its relative change stays large.
  options.gradient_tolerance = 1e-14;
  options.logging_type = ceres::SILENT;
  options.num_threads = 1;  // sums in one order: the same bytes each time
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  return summary.termination_type == ceres::CONVERGENCE;
}

}  // namespace vitreo::control
